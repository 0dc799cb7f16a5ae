"""Every registered plugin keeps the contract."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest

from safe_inspect.dones.shared import CollisionDoneFunction, MultiagentSuccessDoneFunction, SetAllDoneFunction
from safe_inspect.glues.actions import ControllerGlue
from safe_inspect.glues.normalizers import LinearNormalizer, Normalization, StandardNormalNormalizer
from safe_inspect.glues.observations import ObserveSensor
from safe_inspect.platforms.controllers import RateController
from safe_inspect.platforms.neighbour_sensors import (
    NearestDeputiesPositionSensor,
    NearestDeputiesVelocitySensor,
)
from safe_inspect.platforms.point_sensors import InspectedPointsSensor, UninspectedPointsSensor
from safe_inspect.platforms.state_sensors import EntityPositionSensor, SunAngleSensor
from safe_inspect.plugins import Plugin
from safe_inspect.plugins.registry import registry
from safe_inspect.policies import SixDofInspector, ZeroThrust
from safe_inspect.rendezvous.libraries import require
from safe_inspect.rendezvous.plugins import MeshTarget
from safe_inspect.rewards.delta_v import InspectionDeltaVReward
from safe_inspect.rewards.inspection import InspectionCrashReward
from safe_inspect.rta import RTAGlueCWHInspection1v1
from safe_inspect.simulators.resets.initializers import RejectionSamplerInitializer
from safe_inspect.simulators.resets.parameters import (
    ConstantParameter,
    SimAttributeAccessor,
    TruncatedNormalParameter,
    UniformParameter,
)
from safe_inspect.tasks.inspection.simulator import InspectionSimulator
from safe_inspect.tasks.inspection.sun import IlluminationParams
from safe_inspect.testing import check_plugin, sample_spec


def _mesh_file() -> str:
    path = Path(tempfile.mkdtemp()) / "target.stl"
    require("trimesh").creation.box((0.4, 0.3, 0.2)).export(path)
    return str(path)


#: Plugins that cannot be built from their defaults alone: the shipped experiment has one of them.
_NEEDS_FIELDS = {
    ("parameter", "RejectionSampler"): lambda: sample_spec().reset.parameters["init_state"],
    ("target_model", "MeshTarget"): lambda: MeshTarget(path=_mesh_file()),
    # Its default flies as NaturalMotionInspector, whose search takes its time and is checked by itself.
    ("policy", "SixDofInspector"): lambda: SixDofInspector(translation=ZeroThrust()),
}

#: Plugins whose check takes more than ten seconds: a filter with many kernels, a search, depth images.
_SLOW = {("rta", "RTACWHInspectionTeam"), ("policy", "NaturalMotionInspector"), ("front_end", "ModelFrontEnd")}
_PLUGINS = [
    pytest.param(kind, name, id=f"{kind}-{name}", marks=[pytest.mark.slow] if (kind, name) in _SLOW else [])
    for kind in registry.kinds()
    for name, cls in registry.items(kind)
    if cls.__module__.startswith("safe_inspect.")  # other tests define further plugins
]


@pytest.mark.parametrize(("kind", "name"), _PLUGINS)
def test_registered_plugin_keeps_the_contract(kind: str, name: str) -> None:
    make = _NEEDS_FIELDS.get((kind, name))
    check_plugin(registry.get(kind, name) if make is None else make())


def test_every_kind_of_the_package_is_there() -> None:
    expected = {"constraint", "done", "glue", "initializer", "metric", "normalizer", "parameter", "part", "platform",
                "policy", "reward", "simulator"}  # fmt: skip
    assert expected <= set(registry.kinds())


_SCALED = Normalization(normalizer="StandardNormalNormalizer", config={"mu": 1.0, "sigma": [2.0, 3.0, 4.0]})
_OF_TWO = Normalization(normalizer="StandardNormalNormalizer", config={"sigma": [0.5] * 6})
_SWITCHED_OFF = Normalization(enabled=False)


@pytest.mark.parametrize(
    "plugin",
    [
        CollisionDoneFunction(safety_constraint="0.02 km"),
        ConstantParameter(value=3.0, units="km"),
        ControllerGlue(controller="X Thrust", normalization=_SWITCHED_OFF),
        ControllerGlue(controller="Y Thrust"),
        EntityPositionSensor(entity_name="blue2"),
        InspectedPointsSensor(inspector_entity_name="blue0"),
        InspectedPointsSensor(inspector_entity_name="blue1"),
        InspectionCrashReward(reference_position_sensor_name="reference_position"),
        InspectionDeltaVReward(mode="constant", scale=-0.5, step_size="1 min", mass=6.0),
        InspectionSimulator(illumination_params=IlluminationParams(ray_offset=1e-5), field_of_view="60 deg"),
        InspectionSimulator(illumination_params=None, delta_v_scale_bounds=(-0.2, -0.1)),
        LinearNormalizer(minimum=0.0, maximum=10.0),
        MultiagentSuccessDoneFunction(success_function_name="CrashDoneFunction"),
        NearestDeputiesPositionSensor(k=5, max_range="0.1 km"),
        NearestDeputiesVelocitySensor(k=1),
        ObserveSensor(sensor="Sensor_NearestDeputiesPosition", output_units="km", normalization=Normalization()),
        ObserveSensor(sensor="Sensor_NearestDeputiesVelocity", normalization=_OF_TWO),
        ObserveSensor(sensor="Sensor_Position", output_units="km", normalization=_SCALED),
        ObserveSensor(sensor="Sensor_UninspectedPoints"),
        RateController(name="Fine", axis=2, properties={"low": -0.5, "high": 0.25}),
        RejectionSamplerInitializer(states=("position", "velocity", "sun_angle")),
        RTAGlueCWHInspection1v1(wrapped=tuple(ControllerGlue(controller=f"{axis} Thrust") for axis in "XYZ")),
        SetAllDoneFunction(statuses=("lose",)),
        SimAttributeAccessor(attribute_name="init_state.sun_angle"),
        SunAngleSensor(wrap=False),
        StandardNormalNormalizer(mu=(1.0, 2.0), sigma=(0.5, 4.0)),
        TruncatedNormalParameter(mu=10.0, std=5.0, low=2.0, high=12.0, units="deg"),
        UniformParameter(low=-1.0, high=4.0, units="mm/s"),
        UninspectedPointsSensor(points_per_cluster=7, max_iterations=3),
        UninspectedPointsSensor(inspector_entity_name="blue0"),
    ],
    ids=repr,
)
def test_configured_plugin_keeps_the_contract(plugin: Plugin) -> None:
    check_plugin(plugin)
