//! Names faults.
