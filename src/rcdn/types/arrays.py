"""Shapes and kinds of arrays in annotations, in jaxtyping's notation: `Real[Array, "n 2"]`.

For Python and type checkers they are plain arrays, so that nothing needs jaxtyping; the tests read them with it and
check with beartype that each call's arrays have the shapes that its function states, the same letter being the same
number. `Real`: of numbers, truth values among them; `Shaped`: of anything.
"""

from typing import Annotated as Bool
from typing import Annotated as Int
from typing import Annotated as Real
from typing import Annotated as Shaped

__all__ = ["Bool", "Int", "Real", "Shaped"]
