"""Built-in data: pictures, depth images, meshes, clouds and volumes, made when asked for."""
