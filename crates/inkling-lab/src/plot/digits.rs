//! Numbers for readers, with as many digits as say something. In: a value, perhaps with its 95 % interval and
//! its unit. Out: text. Without an interval a number has four significant digits; with one, the last digit is
//! the second digit of the interval's half-width (`alike`). A value that is not finite becomes "–".

const LEAST_P: f64 = 1e-16;

pub fn short(x: f64) -> String {
    significant(x, 4)
}

/// Without trailing zeros; exponential below 1e-4 and from 1e6 on.
pub fn significant(x: f64, digits: i32) -> String {
    if !x.is_finite() {
        return "–".to_owned();
    }
    if x == 0.0 {
        return "0".to_owned();
    }
    // rounded first: 9.9996 becomes 10.00, with one digit more before the point
    let rounded: f64 = format!("{x:.*e}", (digits - 1).max(0) as usize).parse().unwrap_or(x);
    let power = rounded.abs().log10().floor() as i32;
    if !(-4..6).contains(&power) {
        let (number, exponent) = (rounded / 10f64.powi(power), power);
        return format!("{}e{exponent}", trimmed(&format!("{number:.*}", (digits - 1) as usize)));
    }
    trimmed(&format!("{rounded:.*}", (digits - 1 - power).max(0) as usize))
}

fn trimmed(text: &str) -> String {
    let cut = text.trim_end_matches('0').trim_end_matches('.');
    if text.contains('.') { cut.into() } else { text.into() }
}

pub fn chance(p: f64) -> String {
    if p < LEAST_P { "< 1e-16".to_owned() } else { significant(p, 2) }
}

/// "p = .." or "p < ..".
pub fn p_is(p: f64) -> String {
    let text = chance(p);
    if text.starts_with('<') { format!("p {text}") } else { format!("p = {text}") }
}

/// A value with its 95 % interval and its unit: 77.0 kHz (75.4 to 78.6). s and Hz get a prefix, and a unit of
/// 1 is left out.
pub fn measured(value: f64, [low, high]: [f64; 2], unit: &str) -> String {
    let (by, unit) = prefixed(value, unit);
    let [value, low, high] = [value, low, high].map(|x| x * by);
    let [value, low, high] = alike(value, [low, high]);
    let unit = if unit.is_empty() { unit } else { format!(" {unit}") };
    format!("{value}{unit} ({low} to {high})")
}

fn alike(value: f64, [low, high]: [f64; 2]) -> [String; 3] {
    let all = [value, low, high];
    let half = 0.5 * (high - low).abs();
    let largest = all.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    if !all.iter().all(|x| x.is_finite()) || half <= 1e-9 * largest {
        return all.map(short);
    }

    // power of ten of the half-width's second digit; where it is far from 1, significant digits are counted
    // instead of decimal places
    let last = half.log10().floor() as i32 - 1;
    if !(-6..=5).contains(&last) || !(1e-4..1e7).contains(&largest) {
        let digits = (largest.log10().floor() as i32 - last + 1).clamp(2, 6);
        return all.map(|x| significant(x, digits));
    }

    // round to that power where it is above 1, and give a zero no sign
    let to_grain = |x: f64| match last {
        1.. => (x / 10f64.powi(last)).round() * 10f64.powi(last),
        _ => x,
    };
    all.map(|x| format!("{:.*}", (-last).max(0) as usize, to_grain(x)))
        .map(|x| if x.trim_matches(['-', '0', '.']).is_empty() { "0".into() } else { x })
}

/// The factor for the value, and the name of the unit with the prefix that suits it.
fn prefixed(value: f64, unit: &str) -> (f64, String) {
    // the least value of each prefix, and its factor
    let steps: &[(f64, f64, &str)] = match unit {
        "s" => &[(1.0, 1.0, "s"), (1e-3, 1e3, "ms"), (1e-6, 1e6, "µs"), (0.0, 1e9, "ns")],
        "Hz" => &[(1e6, 1e-6, "MHz"), (1e3, 1e-3, "kHz"), (0.0, 1.0, "Hz")],
        "1" => return (1.0, String::new()),
        _ => &[],
    };
    let fits = steps.iter().find(|(least, ..)| value.abs() >= *least);
    fits.map_or((1.0, unit.to_owned()), |(_, by, name)| (*by, (*name).to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_never_lose_their_size() {
        let cases = [
            (0.0, "0"),
            (1.0, "1"),
            (0.123456, "0.1235"),
            (100_000.0, "100000"),
            (9.99996, "10"),
            (3e-9, "3e-9"),
            (f64::NAN, "–"),
            (-12.5, "-12.5"),
            (-9.99996e-9, "-1e-8"),
            (999_999.9, "1e6"),
        ];
        for (x, text) in cases {
            assert_eq!(short(x), text);
        }
    }

    #[test]
    fn a_value_has_the_digits_of_its_interval_and_no_value_becomes_nothing() {
        let cases: [(f64, [f64; 2], &str, &str); 9] = [
            (76967.0499, [75352.2401, 78581.8596], "Hz", "77.0 kHz (75.4 to 78.6)"),
            (3.58385e-8, [2.9896e-8, 4.1781e-8], "s", "35.8 ns (29.9 to 41.8)"),
            (684_348.227, [651_234.5, 717_461.9], "1/s", "684000 1/s (651000 to 717000)"),
            (0.0151139, [0.013771, 0.016457], "1", "0.0151 (0.0138 to 0.0165)"),
            (3.0, [2.9406, 3.0594], "counts", "3.000 counts (2.941 to 3.059)"),
            (-0.127, [-0.13, -0.124], "1", "-0.1270 (-0.1300 to -0.1240)"),
            (1.1e-7, [0.9e-7, 1.3e-7], "1", "1.1e-7 (9e-8 to 1.3e-7)"),
            (0.001, [-0.02, 0.022], "1", "0.001 (-0.020 to 0.022)"),
            (f64::NAN, [f64::NAN; 2], "1", "– (– to –)"),
        ];
        for (value, interval, unit, text) in cases {
            assert_eq!(measured(value, interval, unit), text);
        }
        assert_eq!(measured(2.0, [2.0, 2.0], "s"), "2 s (2 to 2)");
    }

    #[test]
    fn a_chance_that_is_none_is_a_bound() {
        assert_eq!(p_is(3.21e-321), "p < 1e-16");
        assert_eq!(p_is(0.0), "p < 1e-16");
        assert_eq!(p_is(4.9123e-4), "p = 0.00049");
        assert_eq!(chance(0.83), "0.83");
        assert_eq!(chance(2.04e-9), "2e-9");
    }
}
