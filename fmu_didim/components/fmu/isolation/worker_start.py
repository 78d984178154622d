"""How the process of an FMU begins: no file of the current folder is run in it.

``python -m`` and ``python -c`` look for modules in the current folder first, so that a ``struct.py`` beside an FMU
would be run in their place. This file is therefore run by its path in Python's isolated mode (``-I``), which knows
neither the current folder, nor PYTHONPATH, nor the user's own packages. It takes this package from where the parent
has it, and searches the parent's other folders after all that Python itself finds: they are missed by nothing and
stand in for nothing. It imports nothing of the package before that.
"""

import importlib.util
import sys


def main() -> None:
    """Arguments: ``__init__.py`` of this package, then the folders to search last."""
    package, *folders = sys.argv[1:]
    sys.path += [folder for folder in folders if folder not in sys.path]
    name = "fmu_didim"
    spec = importlib.util.spec_from_file_location(name, package)
    assert spec is not None
    assert spec.loader is not None
    sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules[name])
    from fmu_didim.components.fmu.isolation import worker

    worker.main()


if __name__ == "__main__":
    main()
