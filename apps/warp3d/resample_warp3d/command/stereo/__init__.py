"""Pictures for two eyes: options, eye distance, layouts."""
