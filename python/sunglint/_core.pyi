# The extension module is private: the package's own names are what is promised.
from typing import Any

def __getattr__(name: str) -> Any: ...
