"""Built-in test data: pictures, depth images, meshes, clouds and volumes, generated on demand."""
