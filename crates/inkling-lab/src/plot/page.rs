//! The page that figures and tables stand on: HTML that loads nothing and runs nothing. The report,
//! the evaluation and the critique's report are made with it.
//!
//! In: a title and a body of markup. Out: the text of an HTML file. Names in a recording may be
//! anything, so whoever makes the body must put every text that does not come from this program
//! through [`escaped`] or [`name`].

/// The style sheet, which is written into the page without its line ends.
const STYLE: &str = include_str!("page.css");

/// The page's security policy: nothing may run or be loaded. Pictures are inside the page.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:";

/// The whole page. `title` is escaped here; `body` is markup and must be safe.
pub fn page(title: &str, body: &str) -> String {
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"generator\" content=\"inkling\">\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\
         <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"><title>{}</title>\
         <style>{}</style></head><body>\n{body}</body></html>\n",
        escaped(title),
        STYLE.replace('\n', "")
    )
}

/// A table as HTML. `heads`: with `>` before that of a column of numbers; `rows`: safe markup.
pub fn table<const N: usize>(
    heads: [&str; N],
    rows: impl IntoIterator<Item = [String; N]>,
) -> String {
    let row = |tag: &str, cells: [String; N]| {
        let cells = cells.into_iter().zip(heads).map(|(cell, head)| {
            let class = if head.starts_with('>') { " class=n" } else { "" };
            format!("<{tag}{class}>{cell}</{tag}>")
        });
        format!("<tr>{}</tr>\n", cells.collect::<String>())
    };
    let head = row("th", heads.map(|head| head.trim_start_matches('>').to_owned()));
    let rows: String = rows.into_iter().map(|cells| row("td", cells)).collect();
    format!("<table>{head}{rows}</table>")
}

/// The first `most` of many names, with `between` between two of them: `a, b, and 3 more`.
pub fn first_of(all: &[String], most: usize, between: &str) -> String {
    let named = all[..all.len().min(most)].join(between);
    match all.len().saturating_sub(most) {
        0 => named,
        n => format!("{named}{between}and {n} more"),
    }
}

/// Text from which no markup can be made, and which does not change the direction of reading:
/// characters of HTML become entities, control characters (but not line ends) and those that turn
/// the direction become the replacement character.
pub fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => {
                out.push('\u{fffd}');
            }
            c if c.is_control() && c != '\n' => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

/// A name for the page: cut to 64 characters, then escaped.
pub fn name(text: &str) -> String {
    escaped(&shortened(text, 64))
}

/// The first `most` characters of a text, with an ellipsis if there are more. It is not escaped.
pub fn shortened(text: &str, most: usize) -> String {
    let more = if text.chars().nth(most).is_some() { "…" } else { "" };
    text.chars().take(most).chain(more.chars()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_cannot_be_made_of_text() {
        let text = "<script>alert('\"&')</script>\u{202e}\u{1b}";
        let safe = escaped(text);
        assert!(!safe.contains(['<', '>', '"', '\'', '\u{1b}', '\u{202e}']), "{safe}");
        assert!(name(&"x".repeat(1000)).chars().count() == 65);
        assert!(page("<b>", "").contains("<title>&lt;b&gt;</title>"));
    }
}
