//! The page that figures and tables stand on: HTML that loads nothing and runs nothing. The report
//! and the critique's report are made with it.
//!
//! In: a title and a body of markup. Out: the text of an HTML file. Names in a recording may be
//! anything, so whoever makes the body must put every text that does not come from this program
//! through [`escaped`] or [`name`].

use super::{Figure, inert};

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

/// A row of a table.
pub struct Row {
    /// Attributes of its tag, each with a space before it.
    pub attributes: String,
    /// Its cells, one for each head, which are safe markup.
    pub cells: Vec<String>,
}

impl<C: IntoIterator<Item = String>> From<C> for Row {
    fn from(cells: C) -> Row {
        Row { attributes: String::new(), cells: cells.into_iter().collect() }
    }
}

/// A table as HTML. `class`: how it looks; `heads`: safe markup without tags, with `>` before that of a column
/// of numbers. Each cell knows its head, which a narrow screen shows beside it (class `cards`).
pub fn table<R: Into<Row>>(
    class: &str,
    heads: &[impl AsRef<str>],
    rows: impl IntoIterator<Item = R>,
) -> String {
    let column = heads.iter().map(AsRef::as_ref).map(|head: &str| match head.strip_prefix('>') {
        Some(head) => (" class=n", head),
        None => ("", head),
    });
    let columns: Vec<(&str, &str)> = column.collect();
    let heads = columns.iter().map(|(class, head)| format!("<th{class}>{head}</th>"));
    let row = |row: R| {
        let Row { attributes, cells } = row.into();
        let cells = cells.iter().zip(&columns).map(|(cell, (class, head))| match *head {
            "" => format!("<td{class}>{cell}</td>"),
            _ => format!("<td{class} data-l=\"{head}\">{cell}</td>"),
        });
        format!("<tr{attributes}>{}</tr>\n", cells.collect::<String>())
    };
    let heads: String = heads.collect();
    let rows: String = rows.into_iter().map(row).collect();
    format!("<table class=\"{class}\"><tr class=\"head\">{heads}</tr>\n{rows}</table>\n")
}

/// A figure of this width and height, pixels. `alt`: what it shows, for those who do not see it; if it cannot be
/// drawn, this stands there, with the error.
pub fn figure(figure: &Figure, size: (u32, u32), alt: &str) -> String {
    let alt = escaped(alt);
    match figure.svg(size) {
        Ok(svg) => {
            let named = format!("<svg role=\"img\" aria-label=\"{alt}\" ");
            wide(&svg.replacen("<svg ", &named, 1))
        }
        Err(e) => format!("<p>{alt}: {}</p>\n", escaped(&e)),
    }
}

/// The page's main sentence, in large print, escaped.
pub fn sentence(text: &str) -> String {
    format!("<p class=\"sentence\">{}</p>\n", escaped(text))
}

/// A part that may be wider than a narrow screen, and then moves within the page.
pub fn wide(part: &str) -> String {
    format!("<div class=\"wide\">{part}</div>\n")
}

/// A part of the page under its heading, without one if that is empty. Where the part is empty there is nothing.
pub fn section(heading: &str, part: &str) -> String {
    match (heading, part) {
        ("", _) | (_, "") => part.to_owned(),
        _ => format!("<h2>{heading}</h2>\n{part}"),
    }
}

/// A list of items, which are safe markup; empty if there are none.
pub fn list(items: impl IntoIterator<Item = String>) -> String {
    let items: String = items.into_iter().map(|item| format!("<li>{item}</li>\n")).collect();
    if items.is_empty() { items } else { format!("<ul>\n{items}</ul>\n") }
}

/// A paragraph in small print, escaped.
pub fn note(text: &str) -> String {
    format!("<p class=\"note\">{}</p>\n", escaped(text))
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
            '\n' => out.push(c),
            c => out.push(inert(c)),
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
