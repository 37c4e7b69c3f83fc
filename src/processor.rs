//! Function multiversioning: one function compiled for several SIMD instruction sets; which version runs is decided by
//! the processor at run time.
//!
//! In: a function whose body is `#[inline(always)]`. Out: the same, compiled for AVX-512, for AVX2 and for what every
//! processor of the target has. No product is fused with a sum, so the results do not depend on the version, bit by
//! bit. The streaming kernel chooses once (`detect::tile::Instructions`); functions for whole blocks of work choose
//! at every call.

/// Defines a function that runs `body`, which has the same parameters.
macro_rules! for_processor {
    (
        $(#[$meta:meta])*
        $vis:vis fn $name:ident $(<const $lanes:ident: usize>)? (
            $($arg:ident: $of:ty),* $(,)?
        ) $(-> $out:ty)? { $body:path }
    ) => {
        $(#[$meta])*
        $vis fn $name $(<const $lanes: usize>)? ($($arg: $of),*) $(-> $out)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f")]
                fn with_avx512 $(<const $lanes: usize>)? ($($arg: $of),*) $(-> $out)? {
                    $body($($arg),*)
                }
                #[target_feature(enable = "avx2")]
                fn with_avx2 $(<const $lanes: usize>)? ($($arg: $of),*) $(-> $out)? {
                    $body($($arg),*)
                }
                if std::is_x86_feature_detected!("avx512f") {
                    // SAFETY: the processor was found to have what is asked of it
                    return unsafe { with_avx512($($arg),*) };
                }
                if std::is_x86_feature_detected!("avx2") {
                    // SAFETY: as above
                    return unsafe { with_avx2($($arg),*) };
                }
            }
            $body($($arg),*)
        }
    };
}

pub(crate) use for_processor;
