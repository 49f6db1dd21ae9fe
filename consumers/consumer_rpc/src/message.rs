//! Requests as clients write them, and the bytes of responses.

use launch_cli::logging::cut;

use crate::fields::{Fields, Wrong};
use crate::list;
use crate::msgpack::{self, Value};

/// A request of msgpack-rpc.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Number of the request, which the response repeats.
    pub id: u32,
    /// Name of the method.
    pub method: String,
    /// All parameters.
    pub args: Vec<Value>,
}

/// Reads a request from a message.
///
/// # Errors
/// If the message is no request; the connection is then of no further use.
pub fn parse(message: Value) -> Result<Request, Wrong> {
    let Value::Array(items) = message else {
        return Err(Wrong::Value(format!(
            "a request is {}, but must be a list",
            message.kind()
        )));
    };
    let mut fields = Fields::new("a request", &items);
    let kind = fields.uint(u64::MAX)?;
    if kind != 0 {
        return Err(Wrong::Value(format!(
            "a message is of type {kind}, but clients send only requests, type 0"
        )));
    }
    let (id, method) = (fields.u32()?, fields.text()?.to_owned());
    fields.list()?;
    let args = match items.into_iter().nth(3) {
        Some(Value::Array(params)) => params,
        _ => Vec::new(),
    };
    Ok(Request { id, method, args })
}

/// Bytes of a response with a result.
pub fn success(id: u32, result: Value) -> Vec<u8> {
    bytes(&list![1u32, id, Value::Nil, result])
}

/// Bytes of a response with an error, which a client raises as an exception that names the method.
pub fn failure(id: u32, error: &str) -> Vec<u8> {
    bytes(&list![1u32, id, error, Value::Nil])
}

/// What rpclib says of a method that it does not have; a long name is cut.
pub fn unknown(method: &str, n_args: usize) -> String {
    let method = cut(method);
    format!("rpclib: server could not find function '{method}' with argument count {n_args}.")
}

fn bytes(message: &Value) -> Vec<u8> {
    let mut bytes = Vec::new();
    msgpack::write(&mut bytes, message);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn responses_repeat_the_number_of_their_request() {
        assert_eq!(
            success(300, true.into()),
            [0x94, 1, 0xcd, 1, 44, 0xc0, 0xc3]
        );
        assert_eq!(failure(2, "no"), [0x94, 1, 2, 0xa2, b'n', b'o', 0xc0]);
    }
}
