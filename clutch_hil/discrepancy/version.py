"""The version of the engine, under which the battery stores its answers."""

# Increase it with every change of a verdict, a name, or a strength beyond its interval. Files may be renamed, cleaned up and
# made faster under the same version. `python -m benchmarks.battery --check` plays a few cases again and compares the answers.
ENGINE_VERSION = 5
