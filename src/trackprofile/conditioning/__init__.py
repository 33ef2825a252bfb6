"""From what a logger wrote to what can be inferred from: clocks, distance, mounting, faults."""
