"""NI data acquisition through the nidaqmx package: this machine's driver or a gRPC device server."""
