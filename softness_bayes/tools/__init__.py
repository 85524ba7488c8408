"""Programs for developers: table builders, benchmarks, and the API reference."""
