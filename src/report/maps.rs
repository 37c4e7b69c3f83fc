//! Maps of printheads as figures: the picture of a [`Head`] within SVG axes, with frames around
//! episodes and a key of the colours.
//!
//! In: a printhead with its map (`map::HeadMap`) and its faults. Out: HTML for the page (`map`,
//! `key`), or PNG images along the recording (`waterfalls`, for `replay --annotate`).
//!
//! A map shows what each channel was found to be. The cells are codes of `map`, and a code is the
//! index of its colour in `COLOURS`. A map is drawn as an
//! embedded PNG with one pixel for each cell, enlarged by the browser without smoothing; axes,
//! frames and letters are SVG above it.

use super::fault::{Fault, what};
use super::map::{Picture, class};
use super::night::whole;
use super::survey::Head;
use super::words::{clock, counted, first_of};
use inkling_core::verdict::Reason;
use inkling_lab::plot::page::{escaped, name, shortened};
use inkling_lab::plot::raster::{Colour, Raster};
use std::collections::BTreeSet;

/// Colours of the map by code, which people with colour blindness can tell apart, too
/// (Okabe and Ito 2008): gap, healthy, rejected, flagged, dried, blocked, air, empty, then own
/// categories, the last colour for all further ones.
const COLOURS: [Colour; 12] = [
    [0xff, 0xff, 0xff],
    [0xdf, 0xe7, 0xee],
    [0x96, 0x96, 0x96],
    [0xf0, 0xe4, 0x42],
    [0x00, 0x72, 0xb2],
    [0x00, 0x00, 0x00],
    [0x56, 0xb4, 0xe9],
    [0xd5, 0x5e, 0x00],
    [0x00, 0x9e, 0x73],
    [0xcc, 0x79, 0xa7],
    [0xe6, 0x9f, 0x00],
    [0x78, 0x50, 0x1a],
];

/// Letters of the survey's first categories, the known ones; own categories have numbers.
const LETTERS: [&str; 4] = ["D", "B", "A", "E"];
/// Most episodes that are marked on a map.
const MOST_MARKED: usize = 1500;
/// Most characters of an episode's explanation that a tooltip shows.
const MOST_OF_A_SENTENCE: usize = 600;
/// Most faults that are named in the text that stands for a picture.
const MOST_IN_WORDS: usize = 8;

/// Margin left of the picture, margin above it, its width, margin below it, in units of the SVG.
const LEFT: f64 = 118.0;
const TOP: f64 = 46.0;
const WIDTH: f64 = 860.0;
const BELOW: f64 = 40.0;
/// Least distance between two labels of times, in units of the SVG.
const LABEL_HEIGHT: f64 = 24.0;

/// The letter of an episode's category, the number of an own one; S: at the sensor line, U: not named.
fn letter(category: Option<&str>, reason: Option<Reason>, categories: &[String]) -> String {
    let at = category.and_then(|category| categories.iter().position(|c| c == category));
    match (category, at) {
        (None, _) if reason == Some(Reason::NoRing) => "S".into(),
        (None, _) | (_, None) => "U".into(),
        (_, Some(at)) if at < LETTERS.len() => LETTERS[at].into(),
        (_, Some(at)) => format!("{}", at + 1 - LETTERS.len()),
    }
}

/// One picture of a printhead, and what is needed to draw it. `height`: in units of the SVG.
struct Map<'a> {
    head: &'a Head,
    faults: &'a [&'a Fault],
    categories: &'a [String],
    picture: Picture,
    height: f64,
}

/// The map of a printhead; empty if it has none. `faults`: of all printheads; `categories`: the survey's.
pub fn map(head: &Head, faults: &[Fault], categories: &[String]) -> Result<String, String> {
    let Some(picture) = head.picture() else { return Ok(String::new()) };
    let of_head = |fault: &&Fault| fault.story.printhead == head.name;
    let faults: Vec<&Fault> = faults.iter().filter(of_head).collect();
    let height = (picture.lines.len() as f64 * 6.0).clamp(120.0, 380.0);
    Map { head, faults: &faults, categories, picture, height }.figure()
}

impl Map<'_> {
    /// The map as SVG: the cells as an embedded image, axes, and marks of the episodes.
    fn figure(&self) -> Result<String, String> {
        let (picture, height) = (&self.picture, self.height);
        let raster = Raster {
            width: picture.columns.len() as u32,
            height: picture.lines.len() as u32,
            palette: &COLOURS,
            cells: &picture.pixels,
        };
        let address = raster.address()?;
        let total = TOP + height + BELOW;
        let alt = escaped(&self.in_words());
        let title = escaped(&self.title());
        let mut svg = format!(
            "<div class=\"wide\"><svg xmlns=\"http://www.w3.org/2000/svg\" width=\"1000\" height=\"{total:.0}\" \
         viewBox=\"0 0 1000 {total:.0}\" role=\"img\" aria-label=\"{alt}\" \
         font-family=\"DejaVu Sans,sans-serif\" font-size=\"12\"><title>{alt}</title>\n\
         <text x=\"{LEFT}\" y=\"17\" font-size=\"15\" font-weight=\"bold\">{title}</text>\n\
         <image href=\"{address}\" x=\"{LEFT}\" y=\"{TOP}\" width=\"{WIDTH}\" height=\"{height:.1}\" \
         preserveAspectRatio=\"none\" style=\"image-rendering:pixelated\"/>\n\
         <rect x=\"{LEFT}\" y=\"{TOP}\" width=\"{WIDTH}\" height=\"{height:.1}\" fill=\"none\" \
         stroke=\"#888\"/>\n"
        );
        self.axes(&mut svg);
        self.marks(&mut svg);
        svg += "</svg></div>\n";
        Ok(svg)
    }

    /// The title of the map, which tells its main result.
    fn title(&self) -> String {
        let Map { head, faults, .. } = self;
        let name = shortened(&head.name, 24);
        let failed: BTreeSet<u32> = faults.iter().map(|f| f.story.channel).collect();
        let open = faults.iter().filter(|f| f.is_open()).count();
        let channels = counted(head.channels.len() as u64, "channel");
        match head.channels.iter().filter(|c| c.judged > 0).count() as u64 {
            0 => format!("{name}: none of {channels} was judged"),
            judged => format!(
                "{name}: {} of {} had a fault, {open} to be cleaned",
                failed.len(),
                counted(judged, "channel")
            ),
        }
    }

    /// The axes: channel numbers below, times at the left.
    fn axes(&self, svg: &mut String) {
        let picture = &self.picture;
        let columns = picture.columns.len();
        let column_width = WIDTH / columns as f64;
        let bottom = TOP + self.height;
        let every = columns.div_ceil(12).max(1);
        // The next larger round step between labelled channels.
        let every =
            [1, 2, 5, 10, 20, 50, 100, 200, 500].into_iter().find(|s| *s >= every).unwrap_or(every);
        for column in (0..columns).step_by(every) {
            let x = LEFT + (column as f64 + 0.5) * column_width;
            *svg += &format!("<path d=\"M{x:.1} {bottom:.1}v5\" stroke=\"#555\"/>\n");
            put(svg, (x, bottom + 17.0), "middle", &picture.columns[column].to_string());
        }
        let per = match picture.channels_per_column {
            1 => String::new(),
            n => format!(", {n} in each column, the worst shown"),
        };
        put(svg, (LEFT + WIDTH / 2.0, bottom + 34.0), "middle", &format!("channel{per}"));
        put(svg, (LEFT - 8.0, TOP - 8.0), "end", "UTC");
        self.times(svg);
    }

    /// Labels of times at the left, at every so many lines of bursts as there is room for, with the date
    /// where it is another than before: `03-14 08:00:10`. Lines are no even time axis.
    fn times(&self, svg: &mut String) {
        let lines = &self.picture.lines;
        let line_height = self.height / lines.len() as f64;
        let every = (LABEL_HEIGHT / line_height).ceil().max(1.0) as usize;
        let mut before = String::new();
        for (k, line) in lines.iter().enumerate().step_by(every) {
            let Some((from_ns, _)) = *line else { continue };
            let y = TOP + (k as f64 + 0.5) * line_height;
            let time = clock(from_ns);
            let date = time.get(..10).unwrap_or_default();
            let shown = if date == before { time.get(11..) } else { time.get(5..) };
            *svg += &format!("<path d=\"M{LEFT:.1} {y:.1}h-5\" stroke=\"#555\"/>\n");
            put(svg, (LEFT - 8.0, y + 4.0), "end", shown.unwrap_or(&time));
            before = date.to_owned();
        }
    }

    /// A frame around each episode, with its letter above and its explanation as a tooltip.
    fn marks(&self, svg: &mut String) {
        let Map { head, faults, categories, picture, height, .. } = self;
        let column_width = WIDTH / picture.columns.len() as f64;
        let line_height = height / picture.lines.len() as f64;
        let spells = faults.iter().flat_map(|f| f.story.spells.iter().map(move |s| (f, s)));
        let mut lettered = None;
        for (fault, spell) in spells.take(MOST_MARKED) {
            // Where: an episode that is still on reaches to the end of its recording.
            let e = &spell.episode;
            let last = head.tallies.get(&spell.recording).and_then(|t| t.span);
            let until = e.ended_at_ns.or(last.map(|span| span.1)).unwrap_or(e.raised_at_ns);
            let (from, to) = (picture.line_of(e.began_at_ns), picture.line_of(until));
            let x = LEFT + picture.column_of(e.channel) as f64 * column_width;
            let y = TOP + from as f64 * line_height;
            let high = ((to.max(from) - from + 1) as f64 * line_height).max(2.0);
            let width = column_width.max(3.0);

            // The frame with its tooltip.
            let until = match e.ended_at_ns {
                Some(end) => format!("to {}", clock(end)),
                None => "to the end of the recording".into(),
            };
            let explained: String = e.explanation.chars().take(MOST_OF_A_SENTENCE).collect();
            let words = format!("{explained}; from {} {until}", clock(e.began_at_ns));
            *svg += &format!(
                "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{high:.1}\" \
             fill=\"#000\" fill-opacity=\"0\" stroke=\"#000\" stroke-width=\".7\"><title>{}</title></rect>\n",
                escaped(&words)
            );

            // Successive episodes of one fault and category share one letter.
            let sign = (fault.story.channel, fault.story.began_at_ns, e.category.as_deref());
            if lettered != Some(sign) {
                lettered = Some(sign);
                *svg += &format!(
                    "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" font-size=\"11\" \
                 font-weight=\"bold\" stroke=\"#fff\" stroke-width=\"3\" paint-order=\"stroke\">{}</text>\n",
                    x + width / 2.0,
                    (y - 2.0).max(TOP - 4.0),
                    letter(e.category.as_deref(), e.reason, categories)
                );
            }
        }
    }

    /// A description of the picture, for those who do not see it.
    fn in_words(&self) -> String {
        let (from, to) = whole(self.picture.lines.iter().copied().flatten()).unwrap_or_default();
        let of_fault = |f: &&Fault| format!("channel {} ({})", f.story.channel, what(&f.story));
        let named: Vec<String> = self.faults.iter().map(of_fault).collect();
        let faults = match named.is_empty() {
            true => String::new(),
            false => format!(": {}", first_of(&named, MOST_IN_WORDS, ", ")),
        };
        let (from, to) = (clock(from), clock(to));
        format!("{}{faults}; channels across, {from} to {to} down", self.title())
    }
}

/// Puts a text beside a point of a figure. `anchor`: which of its ends lies there, as SVG says it.
fn put(svg: &mut String, (x, y): (f64, f64), anchor: &str, text: &str) {
    *svg += &format!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{text}</text>\n");
}

/// Number of lines of each picture of a waterfall.
const WATERFALL: usize = 64;
/// Least width of such a picture, pixels: viewers blur small images when they enlarge these.
const LEAST_WIDTH: usize = 480;

/// The map as it looked at each time. For each line of bursts `each` gets the time of its last
/// burst, ns, and a PNG of that line at the bottom and the 63 lines before it above.
pub fn waterfalls<E: From<String>>(
    head: &Head,
    mut each: impl FnMut(i64, Vec<u8>) -> Result<(), E>,
) -> Result<(), E> {
    let Some(picture) = head.picture() else { return Ok(()) };
    let columns = picture.columns.len();
    // each cell becomes `scale` x `high` pixels
    let scale = LEAST_WIDTH.div_ceil(columns).max(1);
    let high = scale.min(4);
    for (k, line) in picture.lines.iter().enumerate() {
        let Some((_, to_ns)) = line else { continue };
        let from = (k + 1).saturating_sub(WATERFALL);
        // before the first line of the map there are gaps
        let mut cells = vec![class::GAP; (WATERFALL - (k + 1 - from)) * high * columns * scale];
        for line in picture.pixels[from * columns..(k + 1) * columns].chunks(columns) {
            let wide: Vec<u8> = line.iter().flat_map(|c| std::iter::repeat_n(*c, scale)).collect();
            (0..high).for_each(|_| cells.extend(&wide));
        }
        let raster = Raster {
            width: (columns * scale) as u32,
            height: (WATERFALL * high) as u32,
            palette: &COLOURS,
            cells: &cells,
        };
        each(*to_ns, raster.png()?)?;
    }
    Ok(())
}

/// The key of the colours, as HTML.
pub fn key(categories: &[String]) -> String {
    let patch = |([red, green, blue], words): (&Colour, String)| {
        format!(
            "<span class=\"key\"><svg width=\"14\" height=\"14\" viewBox=\"0 0 14 14\" \
             aria-hidden=\"true\"><rect x=\".5\" y=\".5\" width=\"13\" height=\"13\" \
             fill=\"#{red:02x}{green:02x}{blue:02x}\" stroke=\"#888\"/></svg>{words}</span>\n"
        )
    };
    let most = usize::from(class::CATEGORIES);
    let of_category = |(k, category): (usize, &String)| {
        let words = match k + 1 == most && categories.len() > most {
            true => "other categories".to_owned(),
            false => name(&category.replace('_', " ")),
        };
        format!("{words} ({})", letter(Some(category), None, categories))
    };

    // the words of each code, in the order of the codes
    let classes = ["not measured", "healthy", "rejected", "flagged, of no certain category"];
    let classes = classes.into_iter().map(str::to_owned);
    let classes = classes.chain(categories.iter().enumerate().take(most).map(of_category));
    format!("<p>{}</p>\n", COLOURS.iter().zip(classes).map(patch).collect::<String>())
}
