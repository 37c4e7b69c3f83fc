//! The number of identification that nobody derived; docs/numbers.md tells what half and twice of it
//! do.

crate::numbers! {
    /// Smallest span of temperatures, K, between the means of the coldest and the warmest part,
    /// from which ratios of rates are estimated: with less they would be noise.
    least_span_k = 2.0;
}
