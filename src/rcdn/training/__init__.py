"""Networks, losses and the loop that trains them. Needs the extra `train` (torch, Lightning Fabric, TensorBoard, onnx)."""
