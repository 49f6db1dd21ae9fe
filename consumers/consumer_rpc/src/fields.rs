//! Reads the fields of what clients send, strictly: a wrong type, a missing field or a number that
//! is not finite is an error. Values that pass are stored and sent on to other clients, whose
//! processes a value of the wrong type would end.

use crate::msgpack::Value;

/// The fields of one list, in order.
#[derive(Debug)]
pub struct Fields<'v> {
    what: &'static str,
    items: &'v [Value],
    next: usize,
}

/// What is wrong with an argument.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Wrong {
    /// A field is missing.
    #[error("{what} has {n_fields} fields, but field {field} is needed")]
    Missing {
        /// What the fields belong to.
        what: &'static str,
        /// How many fields there are.
        n_fields: usize,
        /// The missing field, counted from 1.
        field: usize,
    },
    /// A field is of another type or outside its range.
    #[error("field {field} of {what} is {is}, but must be {wanted}")]
    Field {
        /// What the field belongs to.
        what: &'static str,
        /// The field, counted from 1.
        field: usize,
        /// What it is.
        is: String,
        /// What it must be.
        wanted: String,
    },
    /// A number does not fit single precision.
    #[error("field {field} of {what} is {number}, which is too large")]
    TooLarge {
        /// What the field belongs to.
        what: &'static str,
        /// The field, counted from 1.
        field: usize,
        /// The number as text.
        number: String,
    },
    /// Values that make no sense, in a sentence.
    #[error("{0}")]
    Value(String),
}

impl<'v> Fields<'v> {
    /// The fields in `items`; errors call them the fields of `what`.
    pub fn new(what: &'static str, items: &'v [Value]) -> Self {
        Fields {
            what,
            items,
            next: 0,
        }
    }

    /// The next field as it is.
    ///
    /// # Errors
    /// When there is none.
    pub fn value(&mut self) -> Result<&'v Value, Wrong> {
        let value = self.items.get(self.next);
        self.next += 1;
        value.ok_or(Wrong::Missing {
            what: self.what,
            n_fields: self.items.len(),
            field: self.next,
        })
    }

    /// The fields that were not read yet.
    pub fn rest(&self) -> &'v [Value] {
        self.items.get(self.next..).unwrap_or_default()
    }

    /// The field that was read last is wrong.
    fn wrong<T>(&self, is: impl ToString, wanted: impl ToString) -> Result<T, Wrong> {
        Err(Wrong::Field {
            what: self.what,
            field: self.next,
            is: is.to_string(),
            wanted: wanted.to_string(),
        })
    }

    /// A bool.
    ///
    /// # Errors
    /// [`Wrong`], as for all below.
    pub fn bool(&mut self) -> Result<bool, Wrong> {
        match self.value()? {
            Value::Bool(b) => Ok(*b),
            other => self.wrong(other.kind(), "a bool"),
        }
    }

    /// An unsigned integer of at most `max`.
    pub fn uint(&mut self, max: u64) -> Result<u64, Wrong> {
        match self.value()? {
            Value::UInt(n) if *n <= max => Ok(*n),
            Value::UInt(n) => self.wrong(n, format!("0 to {max}")),
            other => self.wrong(other.kind(), "an integer that is not negative"),
        }
    }

    /// An actor id or another `u32`.
    pub fn u32(&mut self) -> Result<u32, Wrong> {
        self.uint(u32::MAX.into()).map(|n| n as u32)
    }

    /// A port or another `u16`.
    pub fn u16(&mut self) -> Result<u16, Wrong> {
        self.uint(u16::MAX.into()).map(|n| n as u16)
    }

    /// A `u8`.
    pub fn u8(&mut self) -> Result<u8, Wrong> {
        self.uint(u8::MAX.into()).map(|n| n as u8)
    }

    /// An `i32`.
    pub fn i32(&mut self) -> Result<i32, Wrong> {
        match self.value()? {
            Value::UInt(n) if *n <= i32::MAX as u64 => Ok(*n as i32),
            Value::Int(n) if *n >= i64::from(i32::MIN) => Ok(*n as i32),
            other => self.wrong(other.kind(), "an integer of 32 bits"),
        }
    }

    /// A finite number of any width.
    pub fn f64(&mut self) -> Result<f64, Wrong> {
        let x = match self.value()? {
            Value::F32(x) => f64::from(*x),
            Value::F64(x) => *x,
            Value::UInt(n) => *n as f64,
            Value::Int(n) => *n as f64,
            other => return self.wrong(other.kind(), "a number"),
        };
        if x.is_finite() {
            Ok(x)
        } else {
            self.wrong(x, "finite")
        }
    }

    /// A finite number that fits single precision.
    pub fn f32(&mut self) -> Result<f32, Wrong> {
        let x = self.f64()?;
        if (x as f32).is_finite() {
            Ok(x as f32)
        } else {
            Err(Wrong::TooLarge {
                what: self.what,
                field: self.next,
                number: x.to_string(),
            })
        }
    }

    /// A text.
    pub fn text(&mut self) -> Result<&'v str, Wrong> {
        match self.value()? {
            Value::Str(text) => Ok(text),
            other => self.wrong(other.kind(), "a text"),
        }
    }

    /// A list.
    pub fn list(&mut self) -> Result<&'v [Value], Wrong> {
        match self.value()? {
            Value::Array(items) => Ok(items),
            other => self.wrong(other.kind(), "a list"),
        }
    }

    /// A list; errors call its fields those of `what`.
    pub fn fields(&mut self, what: &'static str) -> Result<Fields<'v>, Wrong> {
        self.list().map(|items| Fields::new(what, items))
    }

    /// A list of lists, as one reader per list; errors call their fields those of `what`.
    pub fn each(&mut self, what: &'static str) -> Result<Vec<Fields<'v>>, Wrong> {
        let items = self.list()?;
        let mut all = Fields::new(what, items);
        items.iter().map(|_| all.fields(what)).collect()
    }

    /// `[false]` or `[true, number]`.
    pub fn optional_f64(&mut self) -> Result<Option<f64>, Wrong> {
        let mut optional = self.fields("an optional number")?;
        if optional.bool()? {
            optional.f64().map(Some)
        } else {
            Ok(None)
        }
    }

    /// Three numbers.
    pub fn vector(&mut self) -> Result<[f64; 3], Wrong> {
        let mut vector = self.fields("a vector")?;
        Ok([vector.f64()?, vector.f64()?, vector.f64()?])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::list;

    #[test]
    fn a_wrong_type_names_the_field() {
        let Value::Array(items) = list![1u32, "two"] else {
            unreachable!()
        };
        let mut fields = Fields::new("a pair", &items);
        assert_eq!(fields.u32(), Ok(1));
        assert_eq!(
            fields.u32().unwrap_err().to_string(),
            "field 2 of a pair is a text, but must be an integer that is not negative"
        );
        assert!(
            fields
                .bool()
                .unwrap_err()
                .to_string()
                .contains("field 3 is needed")
        );
    }
}
