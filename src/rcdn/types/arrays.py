"""Annotations of the shapes and element types of arrays, in jaxtyping's notation: `Float[Array, "n 2"]`.

For Python and type checkers they are plain arrays, so that the package doesn't depend on jaxtyping. The tests interpret
them with jaxtyping and check with beartype that the arrays of each call have the annotated shapes, where equal letters
stand for equal sizes.
"""

from typing import Annotated as Bool
from typing import Annotated as Float
from typing import Annotated as Int
from typing import Annotated as Shaped

__all__ = ["Bool", "Float", "Int", "Shaped"]
