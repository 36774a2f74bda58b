"""`wheelchair studio`: a page in the browser on which people drive and plan in the simulator.

    page/ (JavaScript) <- WebSocket -> server.py -> session -> drive.py -> NavigationEnv

The page draws and reads keys; the chair, its sensors and its judge are those of the environment. It
drives the simulated chair only.
"""
