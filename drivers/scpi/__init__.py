"""Sources that speak SCPI: generators (33210A, 33220A, 33500, 33600), DC supplies (N6900, N7900)."""
