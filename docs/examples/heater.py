"""A heating element as a model of one's own (docs/own_model.md).

Equation        C dT/dt = P - G (T - T_room)
Candidates      radiation, free convection, a slow sensor, a heater that gives less than it is said to

`python heater.py FOLDER` writes runs of a heater that radiates.
"""

import sys
from pathlib import Path

import numpy as np

from clutch_hil.fitting.model import Candidate, Output
from plant_sim.effects.effect import Strength
from protocols.files.parameters import Parameter, ParameterSet
from protocols.files.run import Run
from protocols.files.runs import write_run

ROOM = 20.0  # degC
KELVIN = 273.15  # K at 0 degC
STEFAN_BOLTZMANN = 5.670374e-8  # W/(m^2 K^4), CODATA 2018


class Heater:
    """Power in, temperature out."""

    name = "heater"
    inputs = ("heater_power_w",)
    # 0.05 degC: the sensor's data sheet
    outputs = (Output("temperature_degc", "degC", block="element", resolution=0.05),)
    parameters = ParameterSet({
        p.name: p
        for p in (
            Parameter("element.capacity", 60.0, "J/K", uncertainty=10.0, bounds=(1.0, 1000.0), source="weighed"),
            Parameter("element.loss", 0.4, "W/K", uncertainty=0.2, bounds=(0.01, 10.0), source="still air, estimated"),
        )
    })  # fmt: skip
    candidates = (
        Candidate(
            "radiation", "element", "The element radiates", "P_r = sigma A (T^4 - T_room^4)",
            (Strength("area", "m^2", off=0.0, typical=0.01, bounds=(0.0, 0.2), source="its surface, times emissivity"),),
        ),
        Candidate(
            "free_convection", "element", "Warm air rises, and carries more away", "G = G_0 (1 + k ((T - T_room)/50 K)^0.25)",
            (Strength("gain", "1", off=0.0, typical=0.3, bounds=(0.0, 3.0), source="exponent: laminar, vertical plate"),),
        ),
        Candidate(
            "slow_sensor", "sensor", "The sensor lags behind", "tau dS/dt = T - S",
            (Strength("lag", "s", off=0.0, typical=5.0, bounds=(0.0, 100.0), source="sensors in a sheath: 1 to 30 s"),),
        ),
        Candidate(
            "weak_heater", "heater", "The heater gives less than it is said to", "P = gain P_0 (1 - a (T - T_room))",
            (
                Strength("gain", "1", off=1.0, typical=0.9, bounds=(0.5, 1.5), source="supply voltage +-5 %"),
                Strength("rise", "1/K", off=0.0, typical=5e-4, bounds=(0.0, 0.004), source="a hot wire resists more"),
            ),
        ),
    )  # fmt: skip

    def __init__(self, changed=None):
        """With the parameters `changed` by a model file (`--model`), in which effects may be on."""
        values = {name: p.value for name, p in (changed or {}).items()}
        on = [c for c in self.candidates if any(values.get(f"{c.name}.{s.name}", s.off) != s.off for s in c.strengths)]
        self.found = {name: value for name, value in values.items() if name.split(".")[0] in {c.name for c in on}}
        self.candidates = tuple(c for c in self.candidates if c not in on)
        self.parameters = ParameterSet({name: (changed or {}).get(name, p) for name, p in self.parameters.items()})

    def simulate(self, run, parameters, effects):
        """Temperature [degC] (n,) that the sensor shows for the power [W] of the run."""
        effects = {**self.found, **effects}
        capacity, loss = parameters["element.capacity"], parameters["element.loss"]
        area, convection = effects.get("radiation.area", 0.0), effects.get("free_convection.gain", 0.0)
        gain, rise = effects.get("weak_heater.gain", 1.0), effects.get("weak_heater.rise", 0.0)
        lag = effects.get("slow_sensor.lag", 0.0)
        step = run["time_s"][1] - run["time_s"][0]
        follows = 1.0 - np.exp(-step / lag) if lag > 0.0 else 1.0

        def rate(temperature, power):
            above = temperature - ROOM
            heat = gain * (1.0 - rise * above) * power - loss * above * (1.0 + convection * (abs(above) / 50.0) ** 0.25)
            heat -= STEFAN_BOLTZMANN * area * ((temperature + KELVIN) ** 4 - (ROOM + KELVIN) ** 4)
            return heat / capacity

        temperature = shown = ROOM  # a run begins with a cold element
        predicted = np.empty(len(run["time_s"]))
        for k, power in enumerate(run["heater_power_w"]):
            predicted[k] = shown
            middle = temperature + 0.5 * step * rate(temperature, power)
            temperature += step * rate(middle, power)
            shown += follows * (temperature - shown)
        return {"temperature_degc": predicted}


def measure_heater(seed, levels, seconds=1200.0):
    """A run of a heater that radiates from 0.03 m^2, at the power `levels` [W] one after the other, with the sensor's noise."""
    time = np.arange(0.0, seconds, 2.0)
    power = np.asarray(levels)[np.minimum((time * len(levels) / seconds).astype(int), len(levels) - 1)]
    run = {"time_s": time, "heater_power_w": power.astype(float)}
    truth = Heater().simulate(run, {"element.capacity": 63.0, "element.loss": 0.42}, {"radiation.area": 0.03})
    noise = np.random.default_rng(seed).normal(0.0, 0.05, time.size)
    return run | {"temperature_degc": truth["temperature_degc"] + noise}


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    for name, seed, levels in (("one", 1, (50, 10, 90)), ("two", 2, (20, 80, 0)), ("held_out", 3, (70, 30, 110, 0))):
        write_run(Run(measure_heater(seed, levels), {"rig": "heater"}), folder / f"{name}.parquet")
