"""Components of the tasks, and the simulators composed of them. Importing this package registers their plugins."""

from safe_inspect.tasks import bounded_disturbance, kalman_filter, solar_pressure, thruster_model  # noqa: F401
from safe_inspect.tasks.docking import simulator as docking_simulator  # noqa: F401
from safe_inspect.tasks.docking import target, tumble_parameter  # noqa: F401
from safe_inspect.tasks.inspection import simulator as inspection_simulator  # noqa: F401
