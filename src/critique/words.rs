//! A critique in words: a sentence of each cause, one of all, and the extended equation.
//!
//! In: causes and verdict. Out: text.

use super::adequacy;
use super::catalogue::{entry_of, experiment};
use super::digits;
use super::finding::{Cause, Detection, Verdict};

/// One sentence of a cause: what, how large.
pub fn cause_sentence(cause: &Cause) -> String {
    let entry = entry_of(&cause.id);
    let number = digits::measured(cause.value, cause.ci95, &cause.unit);
    format!("{}: {} = {number}", entry.words, cause.parameter)
}

pub fn sentence(
    verdict: Verdict,
    causes: &[Cause],
    left: &adequacy::Left,
    detection: Detection,
) -> String {
    match verdict {
        Verdict::None => "The model explains these signals: nothing in them asks for more.".into(),
        Verdict::Unknown => {
            let what = left.significant.first().map_or("a misfit", String::as_str);
            match causes.first() {
                Some(c) => format!(
                    "The model misses something that the catalogue does not hold ({what}); nearest \
                     is {}, which explains {:.0} % of it.",
                    c.id,
                    100.0 * c.explains.unwrap_or(0.0)
                ),
                None => {
                    format!("The model misses something that the catalogue does not hold ({what}).")
                }
            }
        }
        Verdict::Tie => {
            let c = &causes[0];
            format!(
                "{}; {} explains the signals as well: {}.",
                capital(&c.sentence),
                c.tied_with.join(" or "),
                experiment(&c.id, &c.tied_with[0])
            )
        }
        Verdict::Named => {
            let each: Vec<String> = causes.iter().map(|c| capital(&c.sentence)).collect();
            let detection = match detection {
                Detection::Better => " Fault detection is better with the extension.",
                Detection::Worse => " Fault detection is worse with the extension.",
                Detection::Same => {
                    " Fault detection is the same with the extension, as far as can be told."
                }
                Detection::NotMeasured => "",
            };
            format!("{}.{detection}", each.join(". "))
        }
    }
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |c| c.to_uppercase().chain(letters).collect())
}

pub fn equation(causes: &[Cause]) -> String {
    let mut text = String::from("y = s C e^{A t} x_a + e");
    for cause in causes {
        let term = match cause.id.as_str() {
            "offset" => "+ b",
            "droop" => "- w int_0^t e^{-w(t-u)} y(u) du",
            "meniscus" => "; q_n' gains -(B_t/B_m) V_n/(I_n B_t)",
            "lowpass" => "+ y(0) h e^{-w t}",
            "second_mode" => "+ s e^{-gamma t} (p cos 2 pi f2 t + q sin 2 pi f2 t)",
            "quadratic_drag" => "; q_n' gains -k |q_n| q_n",
            "dry_friction" => "; q_n' gains -mu sign(q_n)",
            "cubic_stiffness" => "; V becomes V + k3 V^3",
            "fractional_damping" => "; (1 - eta) R_n q_n + eta R_n omega^{-1/2} D^{1/2} q_n",
            "tone" => "+ p cos 2 pi f t + q sin 2 pi f t",
            "random_tone" => "+ p cos(2 pi f t + phase of the burst)",
            "trigger_jitter" => {
                "; x_a becomes e^{A delta} x_a, delta one for all channels of a burst"
            }
            "clipping" => "; y becomes min(y, L)",
            "coarse_lsb" => "; y becomes q round(y/q)",
            "previous_tail" => "+ g s f(t + idle time)",
            "crosstalk" => "; s becomes s (1 + kappa n_nb)",
            "temperature" => "; R becomes R (1 + beta (T - mean T))",
            "ageing" => "; R becomes R (1 + a t/run)",
            "position_gradient" => "; 1/B_t changes along the channels",
            "clock_drift" => "; t becomes t (1 + eps t/run)",
            "correlated_noise" => "; e_k = rho e_{k-1} + white",
            "heteroscedastic_noise" => "; var e = v (1 + h f^2/max f^2)",
            _ => "",
        };
        text.push(' ');
        text.push_str(term);
    }
    text
}
