"""A second bench that shares no code with the engine, the physics or the effects of the tool.

Its base is the published model of the bench written again, in plain numbers, on another integrator; what it
hides has other shapes than the tool's library knows. Data from it can prove the tool wrong.
"""
