"""Project texels to pictures, gather them, and the adjoint of both."""
