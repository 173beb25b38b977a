"""Systems of FMUs in the SSP standard (System Structure and Parameterization): read, flattened, written."""
