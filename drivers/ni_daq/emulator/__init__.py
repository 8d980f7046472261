"""A gRPC device server with an emulated NI 9234 in it, for the unmodified nidaqmx package to talk to."""
