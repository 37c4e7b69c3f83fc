//! The page that figures stand on, which loads nothing and runs nothing. In: a title and a body of markup.
//! Out: HTML. Names in a recording may be anything, so every text that does not come from this program goes
//! through [`escaped`].

const STYLE: &str = "body{font:16px/1.5 system-ui,'DejaVu Sans',sans-serif;color:#1a1a1a;background:#fff;\
margin:2rem auto;max-width:66rem;padding:0 1rem}h1{font-size:1.05rem;color:#555;font-weight:600;margin:0}\
.sentence{font-size:1.45rem;line-height:1.35;margin:.4rem 0 1rem}h2{font-size:1.2rem;margin:2.4rem 0 .4rem}\
h3{font-size:1rem;margin:1.4rem 0 .3rem}.wide{overflow-x:auto}\
table{border-collapse:collapse;margin:.6rem 0;font-size:.93rem}th,td{padding:.25rem .8rem .25rem 0;\
text-align:left;border-bottom:1px solid #ddd;vertical-align:top}td.n,th.n{text-align:right;\
font-variant-numeric:tabular-nums;white-space:nowrap}td.t{white-space:nowrap}td.h{min-width:11rem}td.w{min-width:7rem}\
svg{max-width:100%;height:auto;margin:.4rem 0}\
.warn{border-left:.3rem solid #d55e00;padding:.2rem 0 .2rem .8rem;max-width:50rem}.note{color:#555;max-width:46rem}li{margin:.2rem 0}\
.key{display:inline-block;margin:0 1rem .2rem 0;white-space:nowrap}\
.key svg{width:1em;height:1em;margin:0 .3em -.1em 0}dt{font-weight:600}dd{margin:0 0 .5rem 1.2rem}\
a{color:#05a}.dot{width:.85em;height:.85em;margin:0 .35em -.05em 0;max-width:none}.small{color:#555;font-size:.88rem}\
.heads span{display:inline-block;margin:0 1.4rem .3rem 0}.by{position:absolute;opacity:0}.by+label{display:inline-block;\
padding:.1rem .7rem;margin:0 .3rem .4rem 0;border:1px solid #bbb;border-radius:1rem;font-size:.88rem;cursor:pointer}\
.by:checked+label{background:#1a1a1a;color:#fff}.by:focus+label{outline:2px solid #05a}\
.list{width:100%}.list tbody{display:flex;flex-direction:column}.list tr{display:grid;order:var(--a);\
grid-template-columns:5rem minmax(0,1.1fr) minmax(0,1.2fr) minmax(0,2fr) minmax(0,1.6fr) 5.5rem;column-gap:.8rem;\
border-bottom:1px solid #ddd;scroll-margin-top:1rem}.list tr.head{order:-1}.list td,.list th{border:0;padding:.3rem 0;\
overflow-wrap:anywhere;white-space:normal}.list tr:target{background:#fff6d8}\
#by1:checked~.list tr:not(.head){order:var(--b)}#by2:checked~.list tr:not(.head){order:var(--c)}\
#by3:checked~.list tr:not(.head){order:var(--d)}\
@media(max-width:44rem){.wide>svg{max-width:none;width:38rem}.cards tr.head{display:none}.cards,.cards tbody{display:flex;\
flex-direction:column;width:100%}.cards tr,.list tr{display:block;border:1px solid #ccc;border-radius:.5rem;padding:.4rem .8rem;\
margin:.3rem 0}.cards td,.cards td.n,.cards td.t{display:block;text-align:left;border:0;padding:.1rem 0;white-space:normal;\
overflow-wrap:anywhere;min-width:0}.cards td[data-l]::before{content:attr(data-l) ': ';color:#555}}\
@media print{body{margin:0}}";

/// Security policy: nothing may run or be loaded. Pictures are inside the page.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:";

/// A whole page.
pub fn page(title: &str, body: &str) -> String {
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"generator\" content=\"inkling\">\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\
         <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"><title>{}</title>\
         <style>{STYLE}</style></head><body>\n{body}</body></html>\n",
        escaped(title)
    )
}

/// A table. `heads`: of the columns, with `>` before that of a column of numbers; `rows`: cells of markup.
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

/// The first of many names: `a, b, and 3 more`.
pub fn first_of(all: &[String], most: usize, between: &str) -> String {
    let named = all[..all.len().min(most)].join(between);
    match all.len().saturating_sub(most) {
        0 => named,
        n => format!("{named}{between}and {n} more"),
    }
}

/// Text from which no markup can be made, and which does not change the direction of reading.
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

/// A name, escaped, cut to at most so many characters.
pub fn name(text: &str) -> String {
    const MOST: usize = 64;
    let mut short: String = text.chars().take(MOST).collect();
    if text.chars().nth(MOST).is_some() {
        short.push('…');
    }
    escaped(&short)
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
