//! YAML and JSON as a tree that knows its lines. JSON is YAML, too, so one parser reads both.

use saphyr_parser::{Event, Parser};

use crate::fault::Fault;

/// Deepest nesting that is read.
const MAX_DEPTH: usize = 16;
/// Longest value that a sentence quotes, characters.
const MAX_QUOTED: usize = 60;

/// A value, and where it stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Its keys from the root: `cam0.intrinsics`.
    path: String,
    line: usize,
    value: Value,
}

#[derive(Clone, Debug, PartialEq)]
enum Value {
    Text(String),
    List(Vec<Node>),
    Map(Vec<(String, Node)>),
}

/// Reads the first document of a text.
pub fn parse(text: &str) -> Result<Node, Fault> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    // OpenCV begins its files with a directive that YAML does not know: `%YAML:1.0`.
    let (first, rest) = text.split_once('\n').unwrap_or((text, ""));
    let cleaned;
    let text = match first.starts_with("%YAML:") {
        true => {
            cleaned = format!("# \n{rest}");
            &cleaned
        }
        false => text,
    };
    let mut open: Vec<(Node, Option<String>)> = Vec::new();
    for event in Parser::new_from_str(text) {
        let (event, span) = event.map_err(|error| {
            let message = format!("this is neither YAML nor JSON: {}", error.info());
            Fault::at(error.marker().line(), message)
        })?;
        let line = span.start.line();
        if open.len() > MAX_DEPTH {
            let message = format!("it is nested deeper than {MAX_DEPTH} levels");
            return Err(Fault::at(line, message));
        }
        let value = match event {
            Event::Alias(_) => {
                let message = "aliases are not read; write the value itself";
                return Err(Fault::at(line, message));
            }
            Event::Scalar(text, ..) => Value::Text(text.into_owned()),
            Event::SequenceStart(..) => {
                open.push((
                    Node::new(path_in(&open), line, Value::List(Vec::new())),
                    None,
                ));
                continue;
            }
            Event::MappingStart(..) => {
                open.push((
                    Node::new(path_in(&open), line, Value::Map(Vec::new())),
                    None,
                ));
                continue;
            }
            Event::SequenceEnd | Event::MappingEnd => {
                let Some((done, _)) = open.pop() else {
                    continue;
                };
                if open.is_empty() {
                    return Ok(done);
                }
                put(&mut open, done)?;
                continue;
            }
            _ => continue,
        };
        let node = Node::new(path_in(&open), line, value);
        match open.last_mut() {
            // The next value of a map is that of this key.
            Some((
                Node {
                    value: Value::Map(_),
                    ..
                },
                key @ None,
            )) => {
                let Value::Text(text) = node.value else {
                    continue;
                };
                *key = Some(text);
            }
            Some(_) => put(&mut open, node)?,
            None => return Ok(node),
        }
    }
    Err(Fault::new("the file is empty"))
}

/// Path of the next value.
fn path_in(open: &[(Node, Option<String>)]) -> String {
    let Some((node, key)) = open.last() else {
        return String::new();
    };
    match (&node.value, key) {
        (Value::List(list), _) => format!("{}[{}]", node.path, list.len()),
        (_, Some(key)) if node.path.is_empty() => key.clone(),
        (_, Some(key)) => format!("{}.{key}", node.path),
        _ => node.path.clone(),
    }
}

/// Puts a value into the innermost list or map.
fn put(open: &mut [(Node, Option<String>)], node: Node) -> Result<(), Fault> {
    let Some((into, key)) = open.last_mut() else {
        return Ok(());
    };
    match (&mut into.value, key.take()) {
        (Value::List(list), _) => list.push(node),
        (Value::Map(map), Some(key)) => {
            if map.iter().any(|(known, _)| *known == key) {
                let message = format!("{} is there twice", node.name());
                return Err(Fault::at(node.line, message));
            }
            map.push((key, node));
        }
        (Value::Map(_), None) => {
            return Err(Fault::at(node.line, "a key must be a text"));
        }
        (Value::Text(_), _) => {}
    }
    Ok(())
}

impl Node {
    fn new(path: String, line: usize, value: Value) -> Node {
        Node { path, line, value }
    }

    /// A sentence about it.
    pub fn fault(&self, message: impl Into<String>) -> Fault {
        Fault::at(self.line, message)
    }

    /// What it is called in sentences.
    pub fn name(&self) -> &str {
        match self.path.as_str() {
            "" => "the file",
            path => path,
        }
    }

    /// `NAME is VALUE, but must be ALLOWED`.
    pub fn wrong(&self, allowed: &str) -> Fault {
        let value = match &self.value {
            Value::Text(text) => format!("{text:?}"),
            Value::List(list) => format!("a list of {}", list.len()),
            Value::Map(map) => format!("a table of {} keys", map.len()),
        };
        let short: String = value.chars().take(MAX_QUOTED).collect();
        let dots = if short.len() < value.len() { "…" } else { "" };
        self.fault(format!(
            "{} is {short}{dots}, but must be {allowed}",
            self.name()
        ))
    }

    /// The value of a key of a map.
    pub fn get(&self, key: &str) -> Option<&Node> {
        self.entries()
            .find(|(known, _)| *known == key)
            .map(|(_, node)| node)
    }

    /// The value of a key that must be there.
    pub fn need(&self, key: &str) -> Result<&Node, Fault> {
        self.get(key)
            .ok_or_else(|| self.fault(format!("{} has no {key}", self.name())))
    }

    /// Keys and values of a map; none of another value.
    pub fn entries(&self) -> impl Iterator<Item = (&str, &Node)> {
        let entries = match &self.value {
            Value::Map(map) => &map[..],
            _ => &[],
        };
        entries.iter().map(|(key, node)| (key.as_str(), node))
    }

    /// The values of a list.
    pub fn list(&self) -> Option<&[Node]> {
        match &self.value {
            Value::List(list) => Some(list),
            _ => None,
        }
    }

    /// A text.
    pub fn text(&self) -> Option<&str> {
        match &self.value {
            Value::Text(text) => Some(text),
            _ => None,
        }
    }

    /// A finite number.
    pub fn number(&self) -> Result<f64, Fault> {
        let number = self.text().and_then(|it| it.trim().parse::<f64>().ok());
        number
            .filter(|it| it.is_finite())
            .ok_or_else(|| self.wrong("a number"))
    }

    /// A list of numbers.
    pub fn numbers(&self) -> Result<Vec<f64>, Fault> {
        let list = self.list().ok_or_else(|| self.wrong("a list of numbers"))?;
        list.iter().map(Node::number).collect()
    }

    /// So many numbers; `meaning` says which.
    pub fn exactly<const N: usize>(&self, meaning: &str) -> Result<[f64; N], Fault> {
        let numbers = self.numbers()?;
        let n = numbers.len();
        numbers.try_into().map_err(|_| {
            let what = format!(
                "{} has {n} numbers, but must have {N}: {meaning}",
                self.name()
            );
            self.fault(what)
        })
    }

    /// A list of lists: a matrix, row after row.
    pub fn matrix<const ROWS: usize, const COLUMNS: usize>(
        &self,
    ) -> Result<[[f64; COLUMNS]; ROWS], Fault> {
        let allowed = format!("{ROWS} lists of {COLUMNS} numbers");
        let rows = self.list().filter(|rows| rows.len() == ROWS);
        let rows = rows.ok_or_else(|| self.wrong(&allowed))?;
        let mut matrix = [[0.0; COLUMNS]; ROWS];
        for (to, from) in matrix.iter_mut().zip(rows) {
            *to = from.exactly("a row of a matrix")?;
        }
        Ok(matrix)
    }

    /// A number of pixels.
    pub fn pixels(&self) -> Result<u32, Fault> {
        let number = self.number()?;
        let is_whole = number.fract() == 0.0 && (1.0..=65536.0).contains(&number);
        match is_whole {
            true => Ok(number as u32),
            false => Err(self.wrong("a whole number of pixels, 1 to 65536")),
        }
    }

    /// Width and height by their keys.
    pub fn size(&self, width: &str, height: &str) -> Result<[u32; 2], Fault> {
        Ok([self.need(width)?.pixels()?, self.need(height)?.pixels()?])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn yaml_and_json_are_one_tree_with_lines() {
        let yaml = parse("a:\n  b: [1, 2.5]\n  c: x\n").unwrap();
        let json = parse("{\"a\": {\n\"b\": [1,\n 2.5], \"c\": \"x\"}}").unwrap();
        for root in [&yaml, &json] {
            let a = root.need("a").unwrap();
            assert_eq!(a.need("b").unwrap().numbers().unwrap(), [1.0, 2.5]);
            assert_eq!(a.need("c").unwrap().text(), Some("x"));
            assert_eq!(a.need("b").unwrap().name(), "a.b");
        }
        let line = |root: &Node| root.need("a").unwrap().need("c").unwrap().number();
        let fault = line(&yaml).unwrap_err();
        assert_eq!(
            fault.of_file("f.yaml"),
            "f.yaml:3: a.c is \"x\", but must be a number"
        );
        assert_eq!(line(&json).unwrap_err().line, Some(3));
    }

    #[test]
    fn opencv_s_directive_is_no_mistake() {
        let root = parse("%YAML:1.0\n---\nxi: 1.5\nm: !!opencv-matrix\n   data: [ 1., .5e+01 ]\n");
        let root = root.unwrap();
        assert_eq!(root.need("xi").unwrap().number(), Ok(1.5));
        let data = root.need("m").unwrap().need("data").unwrap();
        assert_eq!(data.numbers(), Ok(vec![1.0, 5.0]));
    }

    #[test]
    fn what_is_no_file_of_values_is_refused_with_its_line() {
        let of = |text: &str| parse(text).unwrap_err();
        assert_eq!(of("").message, "the file is empty");
        assert_eq!(of("a: [1, 2\nb: 3\n").line, Some(2));
        assert_eq!(of("a: 1\na: 2\n").message, "a is there twice");
        assert_eq!(of("a: &x [1]\nb: *x\n").line, Some(2));
        let deep = format!("{}{}", "[".repeat(40), "]".repeat(40));
        assert!(of(&deep).message.starts_with("it is nested deeper than"));
        let root = parse("a: .nan\nb: [1]\n").unwrap();
        assert!(root.need("a").unwrap().number().is_err());
        assert_eq!(
            root.need("b")
                .unwrap()
                .exactly::<2>("x and y")
                .unwrap_err()
                .message,
            "b has 1 numbers, but must have 2: x and y"
        );
        assert_eq!(root.need("c").unwrap_err().message, "the file has no c");
    }
}
