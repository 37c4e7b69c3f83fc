//! All numbers of identification that nobody derived; docs/numbers.md tells what half and twice of
//! each do. `temperature.rs` uses the first two, `tangent.rs` the third.

crate::numbers! {
    /// Smallest span of temperatures, K, between the means of the coldest and the warmest part,
    /// from which ratios of rates are estimated: with less they would be noise.
    least_span_k = 2.0;
    /// Standard deviation of the ln of a ratio of rates below which the ratio counts as known. (The
    /// name says "least"; it is the largest that is accepted.)
    least_known = 0.5;
}
