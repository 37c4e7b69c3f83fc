//! Parses message definitions of ROS 2, as recordings carry them in their schemas, into shapes.
//!
//! A definition is the text of the message itself, then the texts of the messages that it uses,
//! each after a line of `=` and a line `MSG: package/Name`. A text has one field a line: type, then
//! name.
//!
//! In, from `plan.rs`: such a text, which anybody may have written. Out: a [`Shape`]: message types
//! by number, the message itself first, none of which contains itself (that is an error). Counts of
//! array elements are not checked here; `ros.rs` bounds them by the message's length.
//!
//! Steps: the text is cut into the lines of each type; from the message itself on, each type is
//! parsed when a field first uses it (depth first).

use super::shape::{Base, Count, Field, MessageType, Shape};
use super::value::Element;
use std::collections::HashMap;

/// Largest definition that is read; real ones have some kB.
const MOST_BYTES: usize = 1 << 20;
/// At most so many messages within messages, so that hostile text cannot overflow the stack.
const MOST_DEPTH: usize = 64;

/// Types that writers leave out of definitions because everybody knows them.
const BUILTIN: [(&str, &[&str]); 3] = [
    ("builtin_interfaces/Time", &["int32 sec", "uint32 nanosec"]),
    ("builtin_interfaces/Duration", &["int32 sec", "uint32 nanosec"]),
    ("std_msgs/Header", &["builtin_interfaces/Time stamp", "string frame_id"]),
];

type LinesOfTypes<'t> = HashMap<String, Vec<&'t str>>;

pub fn shape(text: &[u8], name: &str) -> Result<Shape, String> {
    if text.len() > MOST_BYTES {
        return Err(format!("its definition has {} bytes, too many", text.len()));
    }
    let text = std::str::from_utf8(text).map_err(|_| "its definition is not UTF-8 text")?;

    // the lines belong to the message itself until the first separator
    let root = short(name);
    let mut written: LinesOfTypes = HashMap::new();
    let mut at = root.clone();
    let mut lines = text.lines();
    written.insert(at.clone(), Vec::new());
    while let Some(line) = lines.next() {
        if line.starts_with("====") {
            let title = lines.by_ref().map(str::trim).find(|line| !line.is_empty());
            let of = title.and_then(|title| title.strip_prefix("MSG:")).ok_or_else(|| {
                let title = crate::printable::cell(title.unwrap_or_default());
                format!("its definition has \"{title}\" where MSG: package/Name is due")
            })?;
            at = short(of.trim());
            written.entry(at.clone()).or_default();
        } else if let Some(lines) = written.get_mut(&at) {
            lines.push(line);
        }
    }

    for (name, lines) in BUILTIN {
        written.entry(name.to_owned()).or_insert_with(|| lines.to_vec());
    }
    let mut parser = Parser { types: Vec::new(), written, known: HashMap::new() };
    parser.define(&root, 0)?;
    Ok(Shape { types: parser.types })
}

struct Parser<'t> {
    types: Vec<MessageType>,
    written: LinesOfTypes<'t>,
    /// Numbers of the types by name; `None` while a type is being defined, so that a type that
    /// contains itself is noticed.
    known: HashMap<String, Option<usize>>,
}

impl Parser<'_> {
    fn define(&mut self, name: &str, depth: usize) -> Result<usize, String> {
        match self.known.get(name) {
            Some(Some(number)) => return Ok(*number),
            Some(None) => return Err(format!("its definition: {name} contains itself")),
            None => {}
        }
        if depth > MOST_DEPTH {
            return Err(format!("its definition: more than {MOST_DEPTH} messages in each other"));
        }
        // under definition: a field that meets this type now lies inside it
        self.known.insert(name.to_owned(), None);
        let number = self.types.len();
        self.types.push(MessageType { name: name.to_owned(), ..MessageType::default() });

        let lines = self.written.get(name).cloned();
        let lines = lines.ok_or_else(|| format!("its definition has no {name}"))?;
        let fields = self.fields(name, &lines, depth)?;
        self.types[number].fields = fields;
        self.known.insert(name.to_owned(), Some(number));
        Ok(number)
    }

    fn fields(&mut self, name: &str, lines: &[&str], depth: usize) -> Result<Vec<Field>, String> {
        let mut fields = Vec::new();
        for line in lines {
            let what = |what: &str| {
                let line = crate::printable::cell(line.trim());
                format!("its definition: {name}: \"{line}\": {what}")
            };
            let Some(field) = WrittenField::parse(line).map_err(what)? else { continue };
            let base = match field.primitive().map_err(what)? {
                Some(base) => base,
                None => {
                    let of = resolve(field.base, name, &self.written);
                    Base::Message(self.define(&of, depth + 1)?)
                }
            };
            if field.count == Count::Fixed(0) {
                return Err(what("an array of no elements"));
            }
            let (name, type_name) = (field.name.to_owned(), field.base.to_owned());
            fields.push(Field { name, type_name, base, count: field.count });
        }
        Ok(fields)
    }
}

/// `package/Name`, whatever stands between: ROS 2 writes `package/msg/Name`.
fn short(name: &str) -> String {
    match name.split_once('/') {
        Some((package, rest)) => {
            format!("{package}/{}", rest.rsplit('/').next().unwrap_or_default())
        }
        None => name.to_owned(),
    }
}

/// The full name that `base` means within the message `within`: a type of the same package, else
/// one without a package, else one of any other package.
fn resolve(base: &str, within: &str, written: &LinesOfTypes) -> String {
    if base.contains('/') {
        return short(base);
    }
    let package = within.split_once('/').map_or("", |(package, _)| package);
    let same = format!("{package}/{base}");
    if written.contains_key(&same) {
        return same;
    }
    if written.contains_key(base) {
        return base.to_owned();
    }
    let ending = format!("/{base}");
    written.keys().filter(|name| name.ends_with(&ending)).min().cloned().unwrap_or(same)
}

struct WrittenField<'t> {
    base: &'t str,
    count: Count,
    name: &'t str,
}

impl<'t> WrittenField<'t> {
    /// Parses a line. `None`: the line is no field, but a comment, a constant or empty.
    fn parse(line: &'t str) -> Result<Option<WrittenField<'t>>, &'static str> {
        let code = line.split('#').next().unwrap_or_default().trim();
        if code.is_empty() {
            return Ok(None);
        }
        let (type_name, rest) =
            code.split_once(char::is_whitespace).ok_or("a type without a name")?;
        let rest = rest.trim_start();
        let of_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
        // the name ends where something else begins: `=` of a constant, or a default value
        let (name, rest) = rest.split_at(rest.find(|c| !of_name(c)).unwrap_or(rest.len()));
        if rest.trim_start().starts_with('=') {
            return Ok(None); // a constant
        }
        if name.is_empty() {
            return Err("no name");
        }
        let Some((base, count)) = type_name.split_once('[') else {
            return Ok(Some(WrittenField { base: type_name, count: Count::One, name }));
        };
        let count = count.strip_suffix(']').ok_or("[ without ]")?;
        let count = match count.is_empty() || count.starts_with("<=") {
            true => Count::Counted,
            false => Count::Fixed(count.parse().map_err(|_| "no number of elements")?),
        };
        Ok(Some(WrittenField { base, count, name }))
    }

    /// The type of one element. `None`: it is a message.
    fn primitive(&self) -> Result<Option<Base>, &'static str> {
        // `string<=10`: a bound on the length changes nothing in a message
        let base = self.base.split("<=").next().unwrap_or_default();
        let number = Element::NAMED.iter().find(|(_, name)| *name == base);
        Ok(match base {
            "bool" => Some(Base::Bool),
            "byte" | "char" | "octet" => Some(Base::Number(Element::U8)),
            "string" => Some(Base::Text),
            "wstring" => return Err("wide text: writers disagree on how it lies in a message"),
            "float128" | "long double" => return Err("a number that is not read"),
            _ => number.map(|(element, _)| Base::Number(*element)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::assert_refused;

    const ROS2: &str = "# a wave\nuint8 KIND=3\nstring NAME='a=b # c'\nstd_msgs/Header header\n\
        Wave[<=4] waves # several\nstring<=10 label \"none\"\nfloat32[3] gains [1, 2, 3]\n\
        ================================================================================\n\
        MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n\
        ====\nMSG: acme_msgs/Wave\nint16[] data\nuint32 n 5\n";

    fn parse(text: &str) -> Result<Shape, String> {
        shape(text.as_bytes(), "acme_msgs/msg/Waves")
    }

    #[test]
    fn fields_constants_defaults_and_nested_messages() {
        let found = parse(ROS2).unwrap();
        let names = |i: usize| {
            let fields = found.types[i].fields.iter();
            fields.map(|f| format!("{} {}", f.type_name, f.name)).collect::<Vec<_>>()
        };
        let waves = ["std_msgs/Header header", "Wave waves", "string<=10 label", "float32 gains"];
        assert_eq!(names(0), waves);
        let of = |name: &str| found.types.iter().position(|t| t.name == name).unwrap();
        assert_eq!(names(of("builtin_interfaces/Time")), ["int32 sec", "uint32 nanosec"]);
        assert_eq!(found.types[0].fields[1].base, Base::Message(of("acme_msgs/Wave")));
        assert_eq!(found.types[0].fields[3].count, Count::Fixed(3));
    }

    #[test]
    fn hostile_definitions_are_refused() {
        let bomb: String = (0..70)
            .map(|i| format!("M{i}[2] a\n====\nMSG: acme_msgs/M{i}\n"))
            .chain(["uint8 x\n".to_owned()])
            .collect();
        for (text, says) in [
            ("Waves again\n", "contains itself"),
            ("Nobody x\n", "has no acme_msgs/Nobody"),
            ("int32\n", "without a name"),
            ("int32[ x\n", "[ without ]"),
            ("int32[-1] x\n", "no number of elements"),
            ("wstring w\n", "wide text"),
            ("int32[0] w\n", "no elements"),
            ("int32 x\n====\nIDL: a/b\n", "where MSG"),
            (bomb.as_str(), "more than 64"),
        ] {
            assert_refused(parse(text), &[says]);
        }
        assert!(shape(&vec![b'\n'; MOST_BYTES + 1], "a/B").is_err());
        assert!(shape(&[0xff, 0xfe], "a/B").is_err());
    }
}
