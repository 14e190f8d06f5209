"""The rig: physics, effects, sensors and data acquisition, and the bench that runs it with a controller."""
