//! Numbers that decide and that nobody derived. A room that has any lists them in one table, by [`numbers!`](crate::numbers!).
//!
//! Each is a function, so that what its half and twice do can be asked: by `with`, which the tests of this crate have, and
//! whoever builds it with the feature `ablation`. No other build can change a number.

/// Makes a function of each number of a table, under its name, and a list of all where they can be changed.
#[macro_export]
macro_rules! numbers {
    // what a number is, where its row says nothing else
    (@kind) => {
        f64
    };
    (@kind $kind:ident) => {
        $kind
    };
    ($($(#[$doc:meta])* $name:ident $(: $kind:ident)? = $value:expr;)*) => {
        $(
            $(#[$doc])*
            #[inline]
            pub fn $name() -> $crate::numbers!(@kind $($kind)?) {
                $crate::numbers::as_it_is(stringify!($name), $value) as _
            }
        )*

        #[cfg(any(test, feature = "ablation"))]
        pub const NUMBERS: &[&str] = &[$(stringify!($name)),*];
    };
}

/// The value of a number.
#[cfg(not(any(test, feature = "ablation")))]
#[inline]
pub fn as_it_is(_name: &str, value: f64) -> f64 {
    value
}

#[cfg(any(test, feature = "ablation"))]
pub use changed::{as_it_is, with};

#[cfg(any(test, feature = "ablation"))]
mod changed {
    use std::sync::RwLock;

    static CHANGED: RwLock<(&'static str, f64)> = RwLock::new(("", 1.0));

    pub fn as_it_is(name: &str, value: f64) -> f64 {
        let (changed, times) = *CHANGED.read().expect("nobody panics who holds it");
        if changed == name { value * times } else { value }
    }

    /// What `run` gives where a number is so many times what it is, on all threads.
    pub fn with<T>(name: &'static str, times: f64, run: impl FnOnce() -> T) -> T {
        let set = |to| *CHANGED.write().expect("nobody panics who holds it") = to;
        set((name, times));
        let result = run();
        set(("", 1.0));
        result
    }
}
