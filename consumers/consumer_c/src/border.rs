//! The border to C: what it hands over, and how it learns why a call failed.
//!
//! Every unsafe block of this crate is here. Each rests on what `gantry.h` asks of its caller: a
//! pointer is null or points to what its type says, nothing else uses it while the call lasts, and a
//! handle was made by this library and is used by one thread at a time.

use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::marker::PhantomData;
use std::mem::MaybeUninit;
use std::panic::{AssertUnwindSafe, catch_unwind};

use consumer_kit::LockstepError;
use schema_bus::{BusError, CommandError, LoanError};

/// What a call returns: `gantry_status` of `gantry.h`.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    Ok = 0,
    Nothing = 1,
    Failed = -1,
    Argument = -2,
    NoSuchTopic = -3,
    SchemaVersion = -4,
    TooManyReaders = -5,
    TopicTaken = -6,
    BorrowLimit = -7,
    BadSample = -8,
    Refused = -9,
    Panicked = -10,
}

/// Why a call failed.
#[derive(Debug)]
pub struct Failure {
    status: Status,
    sentence: String,
}

impl Failure {
    /// A failure that this crate finds.
    pub fn new(status: Status, sentence: impl Into<String>) -> Failure {
        // The Rust side speaks of command lines.
        let sentence = sentence
            .into()
            .replace("name its --domain", "open the bus on its domain")
            .replace("choose another with --domain", "choose another name")
            .replace("another --domain", "another domain")
            .replace(
                "rebuild the consumer",
                "build it with the libgantry of the simulator's version",
            );
        Failure { status, sentence }
    }

    /// Whether the topic is not there yet.
    pub fn may_appear(&self) -> bool {
        self.status == Status::NoSuchTopic
    }
}

impl From<BusError> for Failure {
    fn from(error: BusError) -> Failure {
        let status = match &error {
            BusError::NoSuchTopic { .. } => Status::NoSuchTopic,
            BusError::SchemaSkew { .. } => Status::SchemaVersion,
            BusError::TooManyReaders { .. } => Status::TooManyReaders,
            BusError::TopicTaken { .. } => Status::TopicTaken,
            BusError::BorrowLimit { .. } => Status::BorrowLimit,
            BusError::BadFrame { .. } | BusError::BadResult { .. } | BusError::BadSample { .. } => {
                Status::BadSample
            }
            _ => Status::Failed,
        };
        Failure::new(status, error.to_string())
    }
}

impl From<CommandError> for Failure {
    fn from(error: CommandError) -> Failure {
        match error {
            CommandError::Bus(error) => error.into(),
            // As a topic that may still appear: its server starts with the simulator.
            CommandError::NoServer { .. } => Failure::new(Status::NoSuchTopic, error.to_string()),
            other => Failure::new(Status::Failed, other.to_string()),
        }
    }
}

impl From<LockstepError> for Failure {
    fn from(error: LockstepError) -> Failure {
        match error {
            LockstepError::Bus(error) => error.into(),
            LockstepError::Command(CommandError::Bus(error)) => error.into(),
            LockstepError::Command(CommandError::NoServer { .. }) => {
                Failure::new(Status::NoSuchTopic, error.to_string())
            }
            LockstepError::Command(_) => Failure::new(Status::Failed, error.to_string()),
            LockstepError::Refused { .. } => Failure::new(Status::Refused, error.to_string()),
        }
    }
}

impl From<LoanError> for Failure {
    fn from(error: LoanError) -> Failure {
        let status = match &error {
            LoanError::NoFreeSlot { .. } => Status::BorrowLimit,
            _ => Status::Failed,
        };
        let sentence = match &error {
            LoanError::NoFreeSlot { topic, .. } => format!(
                "cannot loan another result of {topic:?}: all its loans are open; send them or give them back"
            ),
            other => other.to_string(),
        };
        Failure::new(status, sentence)
    }
}

thread_local! {
    static LAST_ERROR: RefCell<CString> = RefCell::default();
    static LAST_TEXT: RefCell<CString> = RefCell::default();
}

/// `text` for C, which ends a text at its first zero.
pub fn c_text(text: &str) -> CString {
    CString::new(text.replace('\0', " ")).unwrap_or_default()
}

/// Keeps a text for this thread until the next one, and returns its address.
pub fn keep_text(text: &str) -> *const c_char {
    LAST_TEXT.with(|last| {
        *last.borrow_mut() = c_text(text);
        last.borrow().as_ptr()
    })
}

/// Does what a call does. What goes wrong is kept for `gantry_last_error`.
pub fn call(act: impl FnOnce() -> Result<Status, Failure>) -> Status {
    let failure = match catch_unwind(AssertUnwindSafe(act)) {
        Ok(Ok(status)) => return status,
        Ok(Err(failure)) => failure,
        Err(panic) => Failure::new(
            Status::Panicked,
            format!("a bug of libgantry: {}", words_of(panic.as_ref())),
        ),
    };
    // A thread that is ending has no last error any more.
    let _ = LAST_ERROR.try_with(|last| *last.borrow_mut() = c_text(&failure.sentence));
    failure.status
}

/// As [`call`] for what cannot fail, `other` standing for a panic.
pub fn ask<T>(other: T, act: impl FnOnce() -> T) -> T {
    catch_unwind(AssertUnwindSafe(act)).unwrap_or(other)
}

fn words_of(panic: &(dyn Any + Send)) -> &str {
    let owned = panic.downcast_ref::<String>().map(String::as_str);
    let words = owned.or_else(|| panic.downcast_ref::<&str>().copied());
    words.unwrap_or("it panicked without a word")
}

/// Where a call puts what it found or made.
pub type Out<'a, T> = Option<&'a mut MaybeUninit<T>>;

/// An argument that must not be null.
pub fn needed<T>(argument: Option<T>, name: &str) -> Result<T, Failure> {
    argument.ok_or_else(|| {
        Failure::new(
            Status::Argument,
            format!("the argument {name} is NULL, and must point to something"),
        )
    })
}

/// Puts a new handle where C wants it.
pub fn hand_over<T>(out: &mut MaybeUninit<Option<Box<T>>>, made: T) -> Status {
    out.write(Some(Box::new(made)));
    Status::Ok
}

/// A text of C: null, or characters that a zero ends.
#[repr(transparent)]
#[derive(Debug)]
pub struct Text<'a>(*const c_char, PhantomData<&'a CStr>);

impl<'a> Text<'a> {
    /// The text; `None` if it is null.
    pub fn read(&self, name: &str) -> Result<Option<&'a str>, Failure> {
        if self.0.is_null() {
            return Ok(None);
        }
        // SAFETY: only C makes a `Text`, and a text of C that is not null ends with a zero and stays
        // as it is while the call lasts, which `'a` does not outlive.
        let text = unsafe { CStr::from_ptr(self.0) };
        text.to_str().map(Some).map_err(|fault| {
            Failure::new(
                Status::Argument,
                format!("the argument {name} is not UTF-8 ({fault})"),
            )
        })
    }

    /// The text, which must not be null.
    pub fn needed(&self, name: &str) -> Result<&'a str, Failure> {
        needed(self.read(name)?, name)
    }
}

/// A list of C: null, or the first of as many elements as the next argument says.
#[repr(transparent)]
#[derive(Debug)]
pub struct List<'a, T>(*const T, PhantomData<&'a [T]>);

impl<'a, T: bytemuck::Pod> List<'a, T> {
    /// Its `len` elements.
    pub fn read(&self, len: usize, name: &str) -> Result<&'a [T], Failure> {
        if len == 0 {
            return Ok(&[]);
        }
        let fits = len
            .checked_mul(size_of::<T>())
            .is_some_and(|bytes| isize::try_from(bytes).is_ok());
        if self.0.is_null() || !self.0.is_aligned() || !fits {
            return Err(Failure::new(
                Status::Argument,
                format!("the argument {name} is no list of {len} elements"),
            ));
        }
        // SAFETY: only C makes a `List`. Its pointer is not null and aligned, its bytes are fewer
        // than an address can span, and C promises that so many elements are there while the call
        // lasts. Of a `Pod`, every bit pattern can be read.
        Ok(unsafe { std::slice::from_raw_parts(self.0, len) })
    }
}

/// The sentence of this thread's last error; empty before the first.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_last_error() -> *const c_char {
    ask(c"".as_ptr(), || {
        LAST_ERROR.with(|last| last.borrow().as_ptr())
    })
}
