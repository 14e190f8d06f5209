"""Made-up answers of the battery, for tests of what counts them."""

from benchmarks.battery.score import ANALOG_COLUMNS, Answer
from benchmarks.battery.truth_laws import LAWS
from benchmarks.battery.validity import hash_content

NONE_SHARED = 2  # a law whose parameters the catalogue has not


def make_answer(case: str, names: tuple[str, ...] = (), verdict: str = "named", **more: object) -> Answer:
    """What the engine might say of a case: `names` in one set where the verdict is one_of."""
    _, effects, severity, noise, _ = case.split("/")
    hidden = [] if effects == "none" else effects.split("+")
    answer = {
        "case": case, "content": hash_content(case),
        "truth": {
            "severity": float(severity), "noise": float(noise), "split": "development", "celsius": 70.0,
            "effects": [{"name": n, "block": LAWS[n].block, "law": NONE_SHARED, "strength": 1.0} for n in hidden],
        },
        "verdict": verdict,
        "effects": list(names) if verdict == "named" else [],
        "alternatives": [list(names)] if verdict == "one_of" else [],
        "confidence": 0.9, "parameters": [], "claims": [], "cpu_seconds": 10.0,
        "gap": {c: {"before": 2.0, "after": 1.0, "floor": 1.0} for c in ANALOG_COLUMNS},
        "weighed": {
            "base": 400.0, "best": 110.0, "size": 100, "count": len(names), "gain": 2.9, "excess": 3.0, "rest": 0.1,
            "relief": 0.0, "strain": 0.0, "alike": 1.0,
            "closed": 2.9 / 3.0, "margin": 0.5, "named": list(names), "costs": dict.fromkeys(names, 110.0),
            "steps": [
                {"effects": list(names), "cost": 110.0, "base": 400.0, "excess": 3.0, "rest": 0.1, "taken": True}
            ] if names else [],
        },
    }  # fmt: skip
    return answer | more
