"""Networks, losses and the training loop.

Needs the extra `train` (torch, Lightning Fabric, TensorBoard, onnx); without it, importing raises DependencyError.
"""

from importlib.util import find_spec

from rcdn.errors import DependencyError

_missing = [name for name in ("torch", "lightning_fabric", "tensorboard", "onnx") if find_spec(name) is None]
if _missing:
    raise DependencyError(f"training: {', '.join(_missing)} not installed; run: pip install 'rcdn[train]'")
