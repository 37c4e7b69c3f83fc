//! Function multiversioning: one function compiled for several SIMD instruction sets; every call
//! runs the version for the largest set that the processor has.
//!
//! In: a function. Out, by the macro `for_processor`: the same function, compiled for AVX-512
//! (`avx512f`), for AVX2 and for what every processor of the target has; outside x86-64 for the
//! last alone. The compiler neither fuses a product with a sum nor changes the order of sums, so
//! the results do not depend on the version, bit by bit.

/// Defines a function that runs in the version for the largest set that the processor has and
/// [`Instructions::use_at_most`] allows. It may have one constant parameter, a `usize`. Its body
/// stands in the macro, or is the name of an `#[inline(always)]` function with the same parameters:
/// only code that is inlined into a version is compiled for that version's instructions.
macro_rules! for_processor {
    (
        $(#[$meta:meta])*
        $vis:vis fn $name:ident $(<const $lanes:ident: usize>)? (
            $($arg:ident: $of:ty),* $(,)?
        ) $(-> $out:ty)? { $body:ident }
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
                if $crate::processor::Instructions::Avx512.are_used() {
                    // SAFETY: the processor was found to have AVX-512
                    return unsafe { with_avx512($($arg),*) };
                }
                if $crate::processor::Instructions::Avx2.are_used() {
                    // SAFETY: the processor was found to have AVX2
                    return unsafe { with_avx2($($arg),*) };
                }
            }
            $body($($arg),*)
        }
    };
    (
        $(#[$meta:meta])*
        $vis:vis fn $name:ident $(<const $lanes:ident: usize>)? (
            $($arg:ident: $of:ty),* $(,)?
        ) $(-> $out:ty)? { $($body:tt)* }
    ) => {
        $(#[$meta])*
        $vis fn $name $(<const $lanes: usize>)? ($($arg: $of),*) $(-> $out)? {
            #[inline(always)]
            fn portable $(<const $lanes: usize>)? ($($arg: $of),*) $(-> $out)? { $($body)* }
            $crate::processor::for_processor! {
                #[inline(always)]
                fn by_processor $(<const $lanes: usize>)? ($($arg: $of),*) $(-> $out)? { portable }
            }
            by_processor($($arg),*)
        }
    };
}

pub(crate) use for_processor;

use std::sync::atomic::{AtomicU8, Ordering};

/// A set of vector instructions. Each set has all that the sets before it have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Instructions {
    Portable,
    Avx2,
    Avx512,
}

/// The largest set that may be used, as the number of its variant of [`Instructions`].
static MOST: AtomicU8 = AtomicU8::new(Instructions::Avx512 as u8);

impl Instructions {
    pub const ALL: [Instructions; 3] =
        [Instructions::Portable, Instructions::Avx2, Instructions::Avx512];

    /// From now on, in the whole process, no larger set than this is used: to measure what the
    /// instructions gain, and to test that they change no result. Without effect outside x86-64.
    pub fn use_at_most(self) {
        MOST.store(self as u8, Ordering::Relaxed);
    }

    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub(crate) fn are_used(self) -> bool {
        let has = match self {
            Instructions::Portable => true,
            Instructions::Avx2 => std::is_x86_feature_detected!("avx2"),
            Instructions::Avx512 => std::is_x86_feature_detected!("avx512f"),
        };
        has && MOST.load(Ordering::Relaxed) >= self as u8
    }
}

/// Calls `work` once per instruction set, the largest last, so that nothing is limited afterwards.
/// The limit is one for the whole process, so tests that do this wait for each other; whatever else
/// runs meanwhile is limited too, and gives the same results.
#[cfg(test)]
pub(crate) fn with_each_set(mut work: impl FnMut()) {
    static ONE_AT_A_TIME: std::sync::Mutex<()> = std::sync::Mutex::new(());
    let _waits = ONE_AT_A_TIME.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    for set in Instructions::ALL {
        set.use_at_most();
        work();
    }
}
