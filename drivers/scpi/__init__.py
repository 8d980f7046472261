"""Function generators that speak SCPI: Agilent 33210A, 33220A, 33500 and 33600 series."""
