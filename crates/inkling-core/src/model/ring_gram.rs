//! The normal equations of a ring fit: sums over a signal's samples, for one signal or for one in
//! each SIMD lane.
//!
//! In: what all signals of a fitter share ([`Frame`]), and per lane a trial of damping and
//! frequency. Out: the Gram matrix of the trial's four columns, and their inner products with the
//! signal ([`NormalEquations`]). The trial has the pole Z = e^{(-sigma + i omega) dt}, and u_k = e^{i phi}
//! Z^k. Its columns are
//!
//! ```text
//! p = Re u + real (the real pole's part),   x = t Re u,
//! q = -Im u,                                v = t q,       t in samples.
//! ```
//!
//! The sensitivities by ln sigma and ln omega are combinations of x and v. The columns are never
//! made: the signal's products are the polynomial sum y_k Z^k and its derivative by Z, by Goertzel's
//! recurrence. The Gram matrix consists of sums of k^m Z^{2k}, k^m |Z|^{2k} and k^m (Z l)^k, where
//! l is the real pole's ratio from sample to sample: these have closed forms, or are doubled up
//! (`powers`).

#[derive(Clone, Copy, Debug)]
pub struct Frame {
    pub samples: usize,
    pub sigma_dt: f64,
    pub omega_dt: f64,
    /// Cosine and sine of the phase phi at the first sample.
    pub first: (f64, f64),
    /// The real pole's part per unit amplitude: its value at the first sample, its ratio l from
    /// sample to sample, that to the power of the number of samples, and the part's square norm.
    pub real_share: f64,
    pub real_ratio: f64,
    pub real_over_all: f64,
    pub real_square: f64,
}

/// `gram`: of p, q, x, v (pp, qp, qq, xp, xq, xx, vp, vq, vx, vv); `slope`: their products with y.
#[derive(Clone, Copy, Debug)]
pub struct NormalEquations {
    pub gram: [f64; 10],
    pub slope: [f64; 4],
}

/// A signal's polynomial sum y_k Z^k, divided twice by the quadratic whose roots are Z and its
/// conjugate ([`goertzel`]): one number, or one of each lane.
#[derive(Clone, Copy, Debug)]
pub struct SignalSums<T> {
    pub b_1: T,
    /// y_0 - |Z|² b_2. The polynomial is b_1 Z + `constant`.
    pub constant: T,
    pub c_3: T,
    /// b_2 - |Z|² c_4. The derivative by Z is b_1 + 2 i Im Z (c_3 Z + `of_slope`).
    pub of_slope: T,
}

/// What depends on the pole alone ([`powers`]): one number, or one of each lane.
#[derive(Clone, Copy, Debug)]
pub struct PoleSums<T> {
    /// Real and imaginary part of Z^n.
    pub re: T,
    pub im: T,
    /// The sums of |Z|^2k, k |Z|^2k and k² |Z|^2k over k < n.
    pub decays: [T; 3],
}

impl<const W: usize> SignalSums<[f64; W]> {
    #[inline(always)] // compiled once per instruction set
    pub fn of_lane(&self, l: usize) -> SignalSums<f64> {
        let SignalSums { b_1, constant, c_3, of_slope } = self;
        SignalSums { b_1: b_1[l], constant: constant[l], c_3: c_3[l], of_slope: of_slope[l] }
    }
}

impl<const W: usize> PoleSums<[f64; W]> {
    #[inline(always)] // compiled once per instruction set
    pub fn of_lane(&self, l: usize) -> PoleSums<f64> {
        let [s0, s1, s2] = &self.decays;
        PoleSums { re: self.re[l], im: self.im[l], decays: [s0[l], s1[l], s2[l]] }
    }
}

/// The polynomial sum y_k Z^k of each lane's signal, and its derivative by Z, by real arithmetic.
///
/// Goertzel's recurrence b_k = y_k + 2 Re Z b_{k+1} - |Z|² b_{k+2}, from the last sample to the
/// first, divides the polynomial by the quadratic whose roots are Z and its conjugate. The same
/// recurrence on the b_k, with the result c_k, divides the quotient.
///
/// `y`: N samples, each of all lanes; `twice`: 2 Re Z; `square`: |Z|².
#[inline(always)] // compiled once per instruction set
pub fn goertzel<const W: usize>(
    y: &[[f64; W]],
    twice: &[f64; W],
    square: &[f64; W],
) -> SignalSums<[f64; W]> {
    let zero = [0.0; W];
    let (mut b, mut b_above, mut c, mut c_above) = (zero, zero, zero, zero);
    let at = |k: usize| y.get(k).copied().unwrap_or(zero);

    for y in y.iter().skip(3).rev() {
        for l in 0..W {
            let next = (y[l] - square[l] * b_above[l]) + twice[l] * b[l];
            (b_above[l], b[l]) = (b[l], next);
            let next = (b[l] - square[l] * c_above[l]) + twice[l] * c[l];
            (c_above[l], c[l]) = (c[l], next);
        }
    }

    // the first three samples by themselves, because the second recurrence ends at c_3
    let (y_2, y_1, y_0) = (at(2), at(1), at(0));
    let mut out = SignalSums { b_1: zero, constant: zero, c_3: c, of_slope: zero };
    for l in 0..W {
        let b_2 = (y_2[l] - square[l] * b_above[l]) + twice[l] * b[l];
        let b_1 = (y_1[l] - square[l] * b[l]) + twice[l] * b_2;
        out.b_1[l] = b_1;
        out.constant[l] = y_0[l] - square[l] * b_2;
        out.of_slope[l] = b_2 - square[l] * c_above[l];
    }
    out
}

pub type Complex = nalgebra::Complex<f64>;

/// Z^n and the sums of [`PoleSums`], by doubling along the bits of n: closed forms of the sums would
/// lose their digits where |Z| is near 1, that is, where hardly anything decays. `n`: the number of
/// samples; `re`, `im`: of Z; `square`: |Z|².
#[inline(always)] // compiled once per instruction set
pub fn powers<const W: usize>(
    n: usize,
    [re, im]: [&[f64; W]; 2],
    square: &[f64; W],
) -> PoleSums<[f64; W]> {
    let ([mut all_re, mut all_im], mut decay) = ([*re, *im], *square);
    let [mut s0, mut s1, mut s2] = [[1.0; W], [0.0; W], [0.0; W]];
    // the terms summed so far; Z and |Z|^2 to that power are `all_re`, `all_im` and `decay`
    let mut done = 1.0;
    let bits = usize::BITS - n.leading_zeros();
    for bit in (0..bits.saturating_sub(1)).rev() {
        // double them: the second half has k + done instead of k
        let odd = n >> bit & 1 == 1;
        for l in 0..W {
            let d = decay[l];
            s2[l] += d * (s2[l] + done * (2.0 * s1[l] + done * s0[l]));
            s1[l] += d * (s1[l] + done * s0[l]);
            s0[l] += d * s0[l];
            (all_re[l], all_im[l]) =
                (all_re[l] * all_re[l] - all_im[l] * all_im[l], 2.0 * all_re[l] * all_im[l]);
            decay[l] = d * d;
        }
        done *= 2.0;
        if odd {
            for l in 0..W {
                let d = decay[l];
                s2[l] += done * done * d;
                s1[l] += done * d;
                s0[l] += d;
                (all_re[l], all_im[l]) =
                    (all_re[l] * re[l] - all_im[l] * im[l], all_re[l] * im[l] + all_im[l] * re[l]);
                decay[l] = d * square[l];
            }
            done += 1.0;
        }
    }
    PoleSums { re: all_re, im: all_im, decays: [s0, s1, s2] }
}

const ONE: Complex = Complex { re: 1.0, im: 0.0 };

/// The sums of w^k and of k w^k over k < n in closed form, and 1 / (1 - w). `over_all`: w^n.
#[inline(always)] // compiled once per instruction set
fn geometric(w: Complex, over_all: Complex, n: f64) -> (Complex, Complex, Complex) {
    let (re, im) = (1.0 - w.re, -w.im);
    let norm = 1.0 / (re * re + im * im);
    let inverse = Complex { re: re * norm, im: -im * norm };
    let zeroth = (ONE - over_all) * inverse;
    // (1 - w) sum k w^k = sum_{0 < k < n} w^k - (n - 1) w^n
    let first = (zeroth - ONE - over_all * (n - 1.0)) * inverse;
    (zeroth, first, inverse)
}

/// The normal equations of one lane's trial. `pole`: Z; `along_real`: inner product of the signal
/// with the real pole's part.
#[inline(always)] // compiled once per instruction set
pub fn normal_equations(
    frame: &Frame,
    pole: Complex,
    of_pole: PoleSums<f64>,
    of_signal: SignalSums<f64>,
    along_real: f64,
) -> NormalEquations {
    let n = frame.samples as f64;
    let first = Complex { re: frame.first.0, im: frame.first.1 };
    let PoleSums { re, im, decays: [s0, s1, s2] } = of_pole;
    let over_all = Complex { re, im };

    // the sums of k^m u_k² for m = 0, 1, 2, from those of k^m w^k with w = Z²
    let (w, w_all) = (pole * pole, over_all * over_all);
    let (a0, a1, inverse) = geometric(w, w_all, n);
    // (1 - w) sum k² w^k = sum_{0 < k < n} (2 k - 1) w^k - (n - 1)² w^n
    let a2 = a1 * 2.0 - (a0 - ONE) - w_all * ((n - 1.0) * (n - 1.0));
    let turned = first * first;
    let (a0, a1, a2) = (a0 * turned, a1 * turned, a2 * inverse * turned);

    // the sums of u_k and k u_k times the real pole's part, which falls by l from sample to sample
    let (c0, c1, _) = geometric(pole * frame.real_ratio, over_all * frame.real_over_all, n);
    let share = first * frame.real_share;
    let (c0, c1) = (c0 * share, c1 * share);

    // from (Re u)² = (|u|² + Re u²) / 2, (Im u)² = (|u|² - Re u²) / 2, Re u Im u = Im u² / 2
    let gram = [
        0.5 * (s0 + a0.re) + 2.0 * c0.re + frame.real_square,
        -0.5 * a0.im - c0.im,
        0.5 * (s0 - a0.re),
        0.5 * (s1 + a1.re) + c1.re,
        -0.5 * a1.im,
        0.5 * (s2 + a2.re),
        -0.5 * a1.im - c1.im,
        0.5 * (s1 - a1.re),
        -0.5 * a2.im,
        0.5 * (s2 - a2.re),
    ];

    // the polynomial at Z, and Z times its derivative for the columns with t
    let SignalSums { b_1, constant, c_3, of_slope } = of_signal;
    let value = Complex { re: b_1 * pole.re + constant, im: b_1 * pole.im } * first;
    let quotient = Complex { re: c_3 * pole.re + of_slope, im: c_3 * pole.im };
    let slope = Complex { re: b_1 - 2.0 * pole.im * quotient.im, im: 2.0 * pole.im * quotient.re };
    let slope = slope * pole * first;
    NormalEquations { gram, slope: [value.re + along_real, -value.im, slope.re, -slope.im] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_what_adding_up_gives() {
        for (n, damping, frequency) in
            [(128, 0.02, 0.3), (61, 1e-5, 0.2), (100, 0.1, 1.7), (3, 0.02, 0.9)]
        {
            let (phase, share, lambda): (f64, f64, f64) = (0.4, 0.06, 0.03);
            let real: Vec<f64> = (0..n).map(|k| share * (-lambda * k as f64).exp()).collect();
            let frame = Frame {
                samples: n,
                sigma_dt: damping,
                omega_dt: frequency,
                first: (phase.cos(), phase.sin()),
                real_share: share,
                real_ratio: (-lambda).exp(),
                real_over_all: (-lambda * n as f64).exp(),
                real_square: real.iter().map(|r| r * r).sum(),
            };
            let y: Vec<[f64; 1]> = (0..n).map(|k| [(k as f64 * 0.37).sin() + 0.2]).collect();
            let decay = (-damping).exp();
            let z = Complex { re: decay * frequency.cos(), im: decay * frequency.sin() };
            let square = decay * decay;
            let recurrence = goertzel(&y, &[2.0 * z.re], &[square]);
            let of_pole = powers(n, [&[z.re], &[z.im]], &[square]).of_lane(0);
            let along_real = real.iter().zip(&y).map(|(r, y)| r * y[0]).sum();
            let found = normal_equations(&frame, z, of_pole, recurrence.of_lane(0), along_real);
            let column = |k: usize| {
                let (t, u) = (k as f64, decay.powi(k as i32));
                let (sin, cos) = (frequency * t + phase).sin_cos();
                [u * cos + real[k], -u * sin, t * u * cos, -t * u * sin]
            };
            let mut of_gram = found.gram.into_iter();
            for i in 0..4 {
                for j in 0..=i {
                    let want: f64 = (0..n).map(|k| column(k)[i] * column(k)[j]).sum();
                    let size: f64 = (0..n).map(|k| (column(k)[i] * column(k)[j]).abs()).sum();
                    let gram = of_gram.next().unwrap();
                    assert!((gram - want).abs() < 1e-11 * size, "{n} {i} {j}: {gram} {want}");
                }
                let want: f64 = (0..n).map(|k| column(k)[i] * y[k][0]).sum();
                let size: f64 = (0..n).map(|k| (column(k)[i] * y[k][0]).abs()).sum();
                assert!((found.slope[i] - want).abs() < 1e-11 * size, "{n} {i}");
            }
        }
    }
}
