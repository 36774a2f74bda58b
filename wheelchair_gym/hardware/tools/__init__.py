"""A technician's tools: diagnostics, calibration, speed tuning, provisioning and monitoring."""
