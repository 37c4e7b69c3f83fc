//! From dimensions and ink to the rates of a channel, thesis (2-3), (2-4), (2-5).
//!
//! In: lengths, areas and ink properties. Out: the rates a = 1/(I_r B_t), b = 1/(I_n B_t), g =
//! R_r/I_r, d = R_n/I_n, from which a fit of (3-1) or a simulation starts. Only these ratios reach
//! the decay: I, R and B apart are not observable.

use super::InkChannel;
use std::f64::consts::PI;

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Geometry {
    pub restrictor_length_m: f64,
    pub restrictor_area_m2: f64,
    pub nozzle_length_m: f64,
    pub nozzle_area_m2: f64,
    /// Volume of ink in the channel, thesis V_ch.
    pub channel_volume_m3: f64,
    /// Compliance of the actuator, thesis B_act.
    pub actuator_compliance_m3_per_pa: f64,
    pub density_kg_per_m3: f64,
    pub viscosity_pa_s: f64,
    pub speed_of_sound_m_per_s: f64,
}

impl Geometry {
    /// I = rho L / A, kg/m^4, and R = 8 pi mu L / A^2, Pa s/m^3, thesis (2-3) and (2-4).
    fn duct(&self, length_m: f64, area_m2: f64) -> [f64; 2] {
        let inertance = self.density_kg_per_m3 * length_m / area_m2;
        [inertance, 8.0 * PI * self.viscosity_pa_s * length_m / (area_m2 * area_m2)]
    }

    /// Total compliance, thesis (2-5): B_t = B_act + V_ch / (rho c^2), m^3/Pa.
    pub fn compliance_m3_per_pa(&self) -> f64 {
        let c = self.speed_of_sound_m_per_s;
        self.actuator_compliance_m3_per_pa
            + self.channel_volume_m3 / (self.density_kg_per_m3 * c * c)
    }

    pub fn ink_channel(&self) -> InkChannel {
        let [i_r, r_r] = self.duct(self.restrictor_length_m, self.restrictor_area_m2);
        let [i_n, r_n] = self.duct(self.nozzle_length_m, self.nozzle_area_m2);
        let b_t = self.compliance_m3_per_pa();
        InkChannel {
            a_per_s2: 1.0 / (i_r * b_t),
            b_per_s2: 1.0 / (i_n * b_t),
            g_per_s: r_r / i_r,
            d_per_s: r_n / i_n,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn relative(x: f64, expected: f64) -> f64 {
        (x / expected - 1.0).abs()
    }

    #[test]
    fn hand_worked_channel_has_the_rates_of_2_3_to_2_5() {
        let geometry = Geometry {
            restrictor_length_m: 200e-6,
            restrictor_area_m2: 2e-9,
            nozzle_length_m: 40e-6,
            nozzle_area_m2: 0.8e-9,
            channel_volume_m3: 1e-10,
            actuator_compliance_m3_per_pa: 1e-19,
            density_kg_per_m3: 1000.0,
            viscosity_pa_s: 0.01,
            speed_of_sound_m_per_s: 1000.0,
        };
        let channel = geometry.ink_channel();
        // I_r = 1e8, I_n = 5e7, B_t = 1e-19 + 1e-10/1e9 = 2e-19.
        assert!(relative(geometry.compliance_m3_per_pa(), 2e-19) < 1e-12);
        assert!(relative(channel.a_per_s2, 5e10) < 1e-12);
        assert!(relative(channel.b_per_s2, 1e11) < 1e-12);
        // R/I = 8 pi nu / A with nu = 1e-5.
        assert!(relative(channel.g_per_s, 8.0 * PI * 1e-5 / 2e-9) < 1e-12);
        assert!(relative(channel.d_per_s, 8.0 * PI * 1e-5 / 0.8e-9) < 1e-12);
    }
}
