//! Numbers that decide and that nobody derived. A room that has any lists them in one table, by [`numbers!`](crate::numbers!).
//!
//! Each is a function, so that a test can ask what its half and twice do (`with`, in tests alone).

/// Makes a function of each number of a table, under its name, and in tests a list of all.
#[macro_export]
macro_rules! numbers {
    ($($(#[$doc:meta])* $name:ident = $value:expr;)*) => {
        $(
            $(#[$doc])*
            #[inline]
            pub fn $name() -> f64 {
                $crate::numbers::as_it_is(stringify!($name), $value)
            }
        )*

        #[cfg(test)]
        pub const NUMBERS: &[&str] = &[$(stringify!($name)),*];
    };
}

/// The value of a number.
#[cfg(not(test))]
#[inline]
pub fn as_it_is(_name: &str, value: f64) -> f64 {
    value
}

#[cfg(test)]
pub use changed::{as_it_is, with};

#[cfg(test)]
mod changed {
    use std::cell::Cell;

    thread_local! {
        static CHANGED: Cell<(&'static str, f64)> = const { Cell::new(("", 1.0)) };
    }

    pub fn as_it_is(name: &str, value: f64) -> f64 {
        let (changed, times) = CHANGED.get();
        if changed == name { value * times } else { value }
    }

    /// What `run` gives where a number is so many times what it is.
    pub fn with<T>(name: &'static str, times: f64, run: impl FnOnce() -> T) -> T {
        CHANGED.set((name, times));
        let result = run();
        CHANGED.set(("", 1.0));
        result
    }
}
