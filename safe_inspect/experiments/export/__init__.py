"""Export of policies as ONNX files, and as part of the package."""
