//! Calls as clients write them, and CARLA's responses to them.

use consumer_rpc::budget::OverBudget;
use consumer_rpc::message;

use crate::list;
use crate::wire::fields::{Fields, Wrong};
use crate::wire::msgpack::Value;

/// The version this gateway speaks; clients compare it with theirs.
pub const CARLA_VERSION: &str = "0.9.16";

/// What a call returns.
#[derive(Clone, Debug, PartialEq)]
pub enum Answer {
    /// A value in a response record.
    Value(Value),
    /// Success without a value.
    Void,
    /// A value without a response record.
    Bare(Value),
}

/// Why a call failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Failure {
    /// A sentence that the script sees.
    Refused(String),
    /// There is no such method.
    Unknown(String),
}

impl From<String> for Failure {
    fn from(error: String) -> Self {
        Failure::Refused(error)
    }
}

impl From<OverBudget> for Failure {
    fn from(error: OverBudget) -> Self {
        Failure::Refused(error.to_string())
    }
}

impl From<Wrong> for Failure {
    fn from(wrong: Wrong) -> Self {
        Failure::Refused(wrong.to_string())
    }
}

/// Result of a call.
pub type Outcome = Result<Answer, Failure>;

/// A call of a client.
#[derive(Debug, PartialEq)]
pub struct Request {
    /// Number of the request, which the response repeats.
    pub id: u32,
    /// Name of the method.
    pub method: String,
    /// Whether the client discards the answer.
    pub is_async: bool,
    /// Arguments, without the metadata.
    pub args: Vec<Value>,
}

/// Reads a call from a message.
///
/// # Errors
/// If the message is no request; the connection is then of no further use.
pub fn parse(message: Value) -> Result<Request, Wrong> {
    message::parse(message).and_then(call)
}

/// Reads a call from a request: its first parameter is the metadata.
///
/// # Errors
/// If there is no metadata; the connection is then of no further use.
pub fn call(mut request: message::Request) -> Result<Request, Wrong> {
    let mut params = Fields::new("the parameters", &request.args);
    let is_async = params.fields("the metadata")?.bool()?;
    let args = request.args.split_off(1);
    Ok(Request {
        id: request.id,
        method: request.method,
        is_async,
        args,
    })
}

/// Bytes of a response.
pub fn response(id: u32, is_void: bool, outcome: Result<Answer, Failure>) -> Vec<u8> {
    let record = match outcome {
        Ok(Answer::Value(value)) => list![list![1u32, value]],
        Ok(Answer::Void) => list![list![false]],
        Ok(Answer::Bare(value)) => value,
        Err(Failure::Refused(error)) if is_void => list![list![true, list![error]]],
        Err(Failure::Refused(error)) => list![list![0u32, list![error]]],
        Err(Failure::Unknown(error)) => return message::failure(id, &error),
    };
    message::success(id, record)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::msgpack::{self, Limits};

    #[test]
    fn a_request_loses_its_metadata() {
        let request = parse(list![0u32, 5u32, "destroy_actor", list![list![true], 9u32]]).unwrap();
        assert_eq!(
            request,
            Request {
                id: 5,
                method: "destroy_actor".into(),
                is_async: true,
                args: vec![Value::UInt(9)]
            }
        );
    }

    #[test]
    fn outcomes_have_the_documented_shapes() {
        let read =
            |bytes: Vec<u8>| msgpack::read(&mut bytes.as_slice(), Limits::default()).unwrap();
        let refused = || Err(Failure::Refused("no".into()));
        assert_eq!(
            read(response(1, false, Ok(Answer::Value(7u32.into())))),
            list![1u32, 1u32, Value::Nil, list![list![1u32, 7u32]]]
        );
        assert_eq!(
            read(response(1, true, Ok(Answer::Void))),
            list![1u32, 1u32, Value::Nil, list![list![false]]]
        );
        assert_eq!(
            read(response(1, false, refused())),
            list![1u32, 1u32, Value::Nil, list![list![0u32, list!["no"]]]]
        );
        assert_eq!(
            read(response(1, true, refused())),
            list![1u32, 1u32, Value::Nil, list![list![true, list!["no"]]]]
        );
        assert_eq!(
            read(response(1, true, Err(Failure::Unknown("x".into())))),
            list![1u32, 1u32, "x", Value::Nil]
        );
    }
}
