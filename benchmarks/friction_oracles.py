"""Friction models of other packages, driven by the same paths and forces as those of `plant_sim`.

They are used by tests and the benchmark.

What            OpenSeesPy `Parallel` of `ElasticPP`: Maxwell-slip. MuJoCo `dcmotor lugre`: LuGre. Exudyn
                `CoordinateSpringDamperExt` with bristle: one elastic element with Coulomb friction and a Stribeck curve
Assumptions     each package at its default accuracy; the path of the mass of 1 kg is given, or a force drives it
Not modelled    equal Stribeck curves: exp(-(v/v_s)^2) in MuJoCo, exp(-|v|/v_s) in Exudyn, exp(-V_S/|v|) in
                `plant_sim`. Compare at a
                constant level, or at one speed
References      documentation of the packages; docs/friction.md has the results
"""

import time
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any, ClassVar

import numpy as np

from plant_sim.friction.model import Array

MASS = 1.0  # kg, driven mass; chosen: a round number
COST_STEP = 1e-4  # s, step where its cost is measured; chosen: as `DT` of friction.py
DAMPING = 50.0  # Ns/m to ground; chosen: the mass then does not oscillate on the contact stiffness


@dataclass(frozen=True)
class Oracle:
    """A model of another package: `compute_force` along a path, `simulate_slide` of a mass, `measure_cost` of a step."""

    name: ClassVar[str]
    module: ClassVar[str]
    package: ClassVar[str]

    @classmethod
    def is_installed(cls) -> bool:
        """Return whether the package can be used here."""
        try:
            import_module(cls.module)
        except (ImportError, RuntimeError):  # RuntimeError: OpenSeesPy without the system's BLAS
            return False
        return True

    @classmethod
    def install_command(cls) -> str:
        """Return the command that installs the package."""
        return f"pip install {cls.package}"

    @property
    def library(self) -> Any:
        """The package; raises ImportError if it is missing."""
        return import_module(self.module)


@dataclass(frozen=True, eq=False)
class OpenSees(Oracle):
    """Elements of `stiffness` k_i [N/m] (n,) and `limits` W_i [N] (n,) in parallel."""

    stiffness: Array
    limits: Array
    name = "OpenSeesPy Parallel/ElasticPP"
    module = "openseespy.opensees"
    package = "openseespy"  # needs libblas3 and liblapack3 of the system
    PARALLEL: ClassVar[int] = 1000  # tag
    VISCOUS: ClassVar[int] = 1001

    def _make_materials(self) -> Any:
        ops = self.library
        ops.wipe()
        tags = range(1, len(self.stiffness) + 1)
        for tag, k, limit in zip(tags, self.stiffness, self.limits, strict=True):
            ops.uniaxialMaterial("ElasticPP", tag, float(k), float(limit / k))
        ops.uniaxialMaterial("Parallel", self.PARALLEL, *tags)
        return ops

    def compute_force(self, position: Array, dt: float) -> Array:
        """Return the force [N] (n,) along `position` [m] (n,); no dependence on `dt` [s]."""
        ops = self._make_materials()
        ops.testUniaxialMaterial(self.PARALLEL)
        force = np.zeros(position.size)
        for i, strain in enumerate((position - position[0]).tolist()):
            ops.setStrain(strain)
            force[i] = ops.getStress()
        return force

    def simulate_slide(self, force: Array, dt: float) -> Array:
        """Return the position [m] (n,) of the mass under `force` [N] (n,), by Newmark's method."""
        ops = self._make_materials()
        ops.model("basic", "-ndm", 1, "-ndf", 1)
        ops.node(1, 0.0)
        ops.node(2, 0.0)
        ops.fix(1, 1)
        ops.mass(2, MASS)
        ops.uniaxialMaterial("Elastic", self.VISCOUS, 0.0, DAMPING)
        ops.element("zeroLength", 1, 1, 2, "-mat", self.PARALLEL, "-dir", 1)
        ops.element("zeroLength", 2, 1, 2, "-mat", self.VISCOUS, "-dir", 1, "-doRayleigh", 0)
        ops.timeSeries("Path", 1, "-dt", dt, "-values", 0.0, *force.tolist())
        ops.pattern("Plain", 1, 1)
        ops.load(2, 1.0)
        ops.constraints("Plain")
        ops.numberer("Plain")
        ops.system("FullGeneral")
        ops.test("NormUnbalance", 1e-12, 50)
        ops.algorithm("Newton")
        ops.integrator("Newmark", 0.5, 0.25)
        ops.analysis("Transient")
        position = np.zeros(force.size)
        for i in range(force.size):
            if ops.analyze(1, dt) != 0:
                raise RuntimeError(f"OpenSees did not converge at step {i}")
            position[i] = ops.nodeDisp(2, 1)
        ops.wipe()
        return position

    def measure_cost(self, displacement: Array, load: Array) -> float:
        """Return the time of a step [s] over `displacement` [m] (n,), called from Python for each step.

        It does not depend on `load` [N].
        """
        ops = self._make_materials()
        ops.testUniaxialMaterial(self.PARALLEL)
        strains, force = np.cumsum(displacement).tolist(), np.empty(displacement.size)
        set_strain, get_stress = ops.setStrain, ops.getStress
        start = time.perf_counter()
        for i, strain in enumerate(strains):
            set_strain(strain)
            force[i] = get_stress()
        return (time.perf_counter() - start) / displacement.size


@dataclass(frozen=True)
class MuJoCo(Oracle):
    """LuGre: `stiffness` sigma_0 [N/m], `damping` sigma_1 [Ns/m], levels F_C, F_S [N], Stribeck velocity v_s [m/s]."""

    stiffness: float
    coulomb_force: float
    static_force: float
    stribeck_velocity: float = 1e-3
    damping: float = 0.0
    name = "MuJoCo LuGre"
    module = "mujoco"
    package = "mujoco"

    def _make_model(self, dt: float, drag: float) -> tuple[Any, Any]:
        mujoco = self.library
        lugre = (self.stiffness, self.damping, self.coulomb_force, self.static_force, self.stribeck_velocity)
        model = mujoco.MjModel.from_xml_string(
            f"""<mujoco><option timestep="{dt}" gravity="0 0 0" integrator="implicitfast">
            <flag contact="disable" constraint="disable"/></option><worldbody><body>
            <joint name="axis" type="slide" axis="1 0 0" damping="{drag}"/>
            <inertial pos="0 0 0" mass="{MASS}" diaginertia="1 1 1"/></body></worldbody><actuator>
            <dcmotor joint="axis" input="none" motorconst="0 0" resistance="1" lugre="{" ".join(map(repr, lugre))}"/>
            </actuator></mujoco>"""
        )
        return model, mujoco.MjData(model)

    def simulate_bristle(self, velocity: Array, dt: float) -> tuple[Array, Array]:
        """Return the bristle deflection [m] and force [N] (n + 1,) with `velocity` [m/s] (n,), constant over each step.

        The force is the one at the end of the step, at its velocity.
        """
        mujoco = self.library
        model, data = self._make_model(dt, 0.0)
        deflection, force = np.zeros(velocity.size + 1), np.zeros(velocity.size + 1)
        for i, v in enumerate(velocity):
            data.qvel[0] = v
            mujoco.mj_step(model, data)
            deflection[i + 1] = data.act[0]
            data.qvel[0] = v
            mujoco.mj_forward(model, data)
            force[i + 1] = -data.actuator_force[0]
        return deflection, force

    def compute_force(self, position: Array, dt: float) -> Array:
        """Return the force [N] (n,) along `position` [m] (n,)."""
        return self.simulate_bristle(np.diff(position) / dt, dt)[1]

    def sample_force(self, velocity: Array, dt: float) -> Array:
        """Return the force [N] (n,) of `mj_step`: from the bristle and the `velocity` [m/s] (n,) at the start of the step."""
        mujoco = self.library
        model, data = self._make_model(dt, 0.0)
        force = np.zeros(velocity.size)
        for i, v in enumerate(velocity):
            data.qvel[0] = v
            mujoco.mj_step(model, data)
            force[i] = -data.actuator_force[0]
        return force

    def simulate_slide(self, force: Array, dt: float) -> Array:
        """Return the position [m] (n,) of the mass under `force` [N] (n,)."""
        mujoco = self.library
        model, data = self._make_model(dt, DAMPING)
        position = np.zeros(force.size)
        for i, f in enumerate(force):
            data.qfrc_applied[0] = f
            mujoco.mj_step(model, data)
            position[i] = data.qpos[0]
        return position

    def measure_cost(self, displacement: Array, load: Array) -> float:
        """Return the time of a step [s] of the sliding mass, as many as in `displacement`, all in one call."""
        model, data = self._make_model(COST_STEP, DAMPING)
        data.qfrc_applied[0] = 2.0 * self.static_force  # slides
        step = self.library.mj_step
        start = time.perf_counter()
        step(model, data, nstep=displacement.size)
        return (time.perf_counter() - start) / displacement.size


@dataclass(frozen=True)
class Exudyn(Oracle):
    """Elastic Coulomb element: `stiffness` [N/m] in stick, `dynamic_force` and `static_offset` [N], decay v_s [m/s]."""

    stiffness: float
    dynamic_force: float
    static_offset: float = 0.0
    decay_velocity: float = 1e-3
    name = "Exudyn CoordinateSpringDamperExt"
    module = "exudyn"
    package = "exudyn"

    @cached_property
    def _items(self) -> Any:
        return import_module("exudyn.itemInterface")

    def _run(
        self, dt: float, count: int, path: Any = None, force: Any = None, drag: float = 0.0
    ) -> tuple[Array, float]:
        """Return the position and force (n, 2) on `path` or under `force`, functions of time; and the time of a step [s]."""
        exu, items = self.library, self._items
        system = exu.SystemContainer().AddSystem()
        ground = system.AddNode(items.NodePointGround())
        node = system.AddNode(
            items.Node1D(referenceCoordinates=[0.0], initialCoordinates=[0.0], initialVelocities=[0.0])
        )
        system.AddObject(items.Mass1D(nodeNumber=node, mass=MASS))
        markers = [system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=i, coordinate=0)) for i in (ground, node)]
        contact = system.AddObject(
            items.CoordinateSpringDamperExt(
                markerNumbers=markers,
                nodeNumber=system.AddNode(
                    items.NodeGenericData(numberOfDataCoordinates=3, initialCoordinates=[0.0, 0.0, 0.0])
                ),
                dynamicFrictionForce=self.dynamic_force,
                staticFrictionOffsetForce=self.static_offset,
                exponentialDecayStatic=self.decay_velocity,
                stickingStiffness=self.stiffness,
                damping=drag,
            )
        )
        if path is not None:
            system.AddObject(
                items.CoordinateConstraint(
                    markerNumbers=markers, offset=0.0, offsetUserFunction=lambda mbs, t, item, offset: float(path(t))
                )
            )
        if force is not None:
            system.AddLoad(
                items.LoadCoordinate(
                    markerNumber=markers[1], load=0.0, loadUserFunction=lambda mbs, t, load: float(force(t))
                )
            )
        kinds = exu.OutputVariableType
        sensors = [
            system.AddSensor(
                items.SensorObject(objectNumber=contact, outputVariableType=kind, storeInternal=True, writeToFile=False)
            )
            for kind in (kinds.Displacement, kinds.Force)
        ]
        system.Assemble()
        settings = exu.SimulationSettings()
        settings.timeIntegration.numberOfSteps = count
        settings.timeIntegration.endTime = count * dt
        settings.timeIntegration.verboseMode = 0
        settings.timeIntegration.generalizedAlpha.spectralRadius = 0.5
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = dt
        start = time.perf_counter()
        system.SolveDynamic(settings)
        elapsed = time.perf_counter() - start
        return np.stack([system.GetSensorStoredData(s)[:, 1] for s in sensors], axis=1), elapsed / count

    def compute_force(self, position: Array, dt: float) -> Array:
        """Return the force [N] (n,) along `position` [m] (n,)."""
        times = np.arange(position.size) * dt
        return self._run(dt, position.size - 1, path=lambda t: np.interp(t, times, position))[0][:, 1]

    def simulate_slide(self, force: Array, dt: float) -> Array:
        """Return the position [m] (n,) of the mass under `force` [N] (n,)."""
        times = np.arange(1, force.size + 1) * dt
        return self._run(dt, force.size, force=lambda t: np.interp(t, times, force), drag=DAMPING)[0][1:, 0]

    def measure_cost(self, displacement: Array, load: Array) -> float:
        """Return the time of a step [s] of the sliding mass, as many as in `displacement`, all in one call."""
        force = 2.0 * (self.dynamic_force + self.static_offset)
        return self._run(COST_STEP, displacement.size, force=lambda t: force, drag=DAMPING)[1]
