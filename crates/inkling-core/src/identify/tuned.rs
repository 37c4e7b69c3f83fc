//! All numbers of identification that nobody derived; docs/numbers.md tells what half and twice of each do.

crate::numbers! {
    /// A smaller span of temperatures than this tells nothing but noise, K.
    least_span_k = 2.0;
    /// Largest standard deviation of the ln of a ratio of rates that counts as known.
    least_known = 0.5;
}
