"""Films of depth images: pictures with depth of their own, read and rendered one by one."""
