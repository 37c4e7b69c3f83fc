//! What loggers call the fields of a burst, for proposals of dialects (`guess.rs`).
//!
//! In: the fields of a message, and [`Names`]. Out: the path of the field that is called so ([`find`]), or a
//! number in Hz or s where the field's name says another unit ([`sampling`]).

use super::fields::{FieldInfo, Slot};
use super::first_message::FirstMessage;
use crate::time_column::{TimeUnit, words};

/// What a field may be called: two texts with blanks between names. The first has whole names, the
/// likeliest first. The second has words: if no field has one of the whole names, a field with one
/// of these words in its name is taken.
pub struct Names<'a>(&'a str, &'a str);

pub const CHANNELS: Names =
    Names("channels n_channels num_channels channel_count nozzles rows nchannels n_nozzles", "");
pub const COLUMNS: Names = Names(
    "samples_per_channel samples_per_signal n_samples num_samples sample_count columns cols n ns",
    "",
);
pub const FIRST: Names = Names("first_channel channel_offset first_nozzle start_channel first", "");
/// The number of the only channel of a message.
pub const CHANNEL: Names =
    Names("channel ch nozzle channel_id ch_id nozzle_id channel_no nozzle_no channel_number", "");
pub const PERIOD: Names =
    Names("period_s sample_period_s sample_period sampling_period period dt_s dt", "");
pub const RATE: Names = Names(
    "rate_hz sample_rate_hz sampling_rate_hz sample_rate sampling_rate samplerate sampling_frequency \
     fs_hz fs rate",
    "",
);
pub const TIME: Names =
    Names("t_acq acquired_at timestamp stamp time", "stamp timestamp time acquired");
pub const PRINTHEAD: Names = Names("printhead print_head head_id head head_name printhead_id", "");
pub const TEMPERATURE: Names =
    Names("temperature_c temp_c temperature ink_temperature temp", "temp temperature degc celsius");
pub const VOLTAGE: Names =
    Names("drive_voltage_v drive_voltage voltage_v voltage amplitude_v", "voltage volt volts");

/// Words in names of temperatures that are not in degrees Celsius, and of voltages that are not in volts.
pub const NO_CELSIUS: &str = "f k degf fahrenheit kelvin mk mdegc millicelsius";
pub const NO_VOLTS: &str = "mv uv kv millivolt millivolts";

/// What a sample period or a rate is called, and units of rates, Hz.
const OF_PERIOD: [&str; 5] = ["period", "dt", "interval", "spacing", "increment"];
const OF_RATE: [&str; 5] = ["rate", "fs", "sampling", "sample", "samplerate"];
const RATES: [(&str, f64); 4] = [("hz", 1.0), ("khz", 1e3), ("mhz", 1e6), ("ghz", 1e9)];

/// A sample period or rate whose field is named for its unit.
pub struct Sampling {
    /// `rate_hz` or `period_s`.
    pub key: &'static str,
    pub path: String,
    /// Whether the field has the unit of the key.
    pub is_of_key: bool,
    /// The number in the first message, in the key's unit.
    pub value: f64,
}

/// The field that says the sample period or rate, in the unit of its name.
pub fn sampling(first: &FirstMessage) -> Option<Sampling> {
    let numbers = first.fields.iter().filter(|field| field.can_be(Slot::Rate).is_ok());
    numbers.into_iter().find_map(|field| {
        let name = field.path.rsplit('.').next().unwrap_or_default();
        let words = words(name);
        let (last, before) = words.split_last()?;
        let has = |any: &[&str]| before.iter().any(|word| any.contains(&word.as_str()));
        let rate = RATES.iter().find(|(unit, _)| unit == last).map(|(_, hz)| *hz);
        let period = TimeUnit::called(last).filter(|unit| unit.ns <= 1e9);
        // a whole number to divide by keeps 500 ns at 5e-7 s
        let (key, times, per) = match (rate, period) {
            (Some(hz), _) if before.is_empty() || has(&OF_RATE) => ("rate_hz", hz, 1.0),
            (_, Some(unit)) if has(&OF_PERIOD) => ("period_s", 1.0, 1e9 / unit.ns),
            _ => return None,
        };
        let value = first.number(&field.path).filter(|x| x.is_finite() && *x > 0.0)?;
        let is_of_key = times == per;
        Some(Sampling { key, path: field.path.clone(), is_of_key, value: value * times / per })
    })
}

impl Names<'_> {
    pub fn find<'f>(&self, fields: &[&'f FieldInfo]) -> Option<&'f FieldInfo> {
        let first = |is: &dyn Fn(&str) -> bool| {
            // the last name of a path is the field's own, without the messages around it
            fields.iter().find(|f| is(f.path.rsplit('.').next().unwrap_or_default())).copied()
        };
        let Names(whole, words) = self;
        let named = |name: &str| first(&|of| of.eq_ignore_ascii_case(name));
        whole.split(' ').find_map(named).or_else(|| first(&|of| has_word(of, words)))
    }
}

pub fn find(fields: &[FieldInfo], names: &Names, slot: Slot) -> Option<String> {
    let can_be = |field: &&FieldInfo| field.can_be(slot).is_ok();
    let fields: Vec<&FieldInfo> = fields.iter().filter(can_be).collect();
    names.find(&fields).map(|field| field.path.clone())
}

/// Whether a field's own name has one of these words in it: `ink_temp_c` has `temp`.
pub fn has_word(name: &str, words: &str) -> bool {
    let name = name.to_ascii_lowercase();
    let mut parts = name.split(|c: char| !c.is_ascii_alphabetic());
    parts.any(|part| !part.is_empty() && words.split(' ').any(|word| word == part))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_says_the_unit_of_a_temperature_or_a_voltage() {
        let no_celsius =
            ["temp_f", "ink_temp_K", "tempDegF_kelvin"].map(|of| has_word(of, NO_CELSIUS));
        assert_eq!(no_celsius, [true; 3]);
        let celsius =
            ["ink_temp_c", "temperature", "temp_front"].map(|of| has_word(of, NO_CELSIUS));
        assert_eq!(celsius, [false; 3]);
        assert!(has_word("drive_volt_mV", NO_VOLTS) && !has_word("voltage_v", NO_VOLTS));
    }
}
