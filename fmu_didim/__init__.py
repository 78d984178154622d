"""Identify robots and drives from motor torque alone (DIDIM), and find the physical effect that a model lacks.

The verbs take a case, as a path, as a mapping or loaded by :func:`load_case`:

* :func:`check` says what is wrong with it before any long work;
* :func:`identify` gives parameters with their standard deviations, an :class:`Result`;
* :func:`discover` names and adds what the model lacks, a :class:`Discovered`;
* :func:`compare` says what has changed between two results, a :class:`Compared`;
* :func:`simulate` runs its loop, a :class:`Trajectory`;
* :func:`excite` designs the motion that tells most, an :class:`Excited`;
* :func:`name_controller` names the law of a controller that nobody knows, a :class:`NamedController`;
* :func:`export_ssp` writes its loop for other tools, :func:`export_robot` its robot.

Many cases at once are a :func:`campaign` or a :func:`study`, whose runs give :class:`Results`.

    case = load_case("case.yaml")
    outcome = identify(case.with_(train={"torque": {"rate_hz": 20}}))
    print(outcome.summary())

Each name is imported when it is first used; ``__init__.pyi`` lists them and their homes.
"""

import lazy_loader

from fmu_didim.base.version import __version__ as __version__

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
