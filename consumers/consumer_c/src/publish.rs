//! Publishing results: loans of shared memory that a program fills in place.

use std::ptr::null_mut;
use std::sync::Arc;

use schema_bus::{ResultLoan, ResultPublisher, ResultTopic};
use schema_frames::{About, ElementType, PixelFormat, ResultHeader, ResultType};

use crate::border::{Failure, List, Out, Status, Text, ask, call, hand_over, needed};
use crate::place::{BusHandle, Place};
use crate::read::Sample;

/// The handle `gantry_publisher`.
#[derive(Debug)]
pub struct Publisher {
    // Ports go before their node.
    port: Arc<ResultPublisher>,
    place: Arc<Place>,
}

/// The handle `gantry_loan`, which keeps its port: nothing else unmaps its memory.
#[derive(Debug)]
pub struct Loan {
    loan: ResultLoan,
    _port: Arc<ResultPublisher>,
    _place: Arc<Place>,
}

fn named<T>(found: Option<T>, what: &str, name: &str, all: &str) -> Result<T, Failure> {
    found.ok_or_else(|| {
        Failure::new(
            Status::Argument,
            format!("{name:?} is no {what}; it must be one of {all}"),
        )
    })
}

/// Opens a topic of results as its only writer.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_publisher_open(
    bus: Option<&BusHandle>,
    topic: Text<'_>,
    result_type: Text<'_>,
    about: Text<'_>,
    publisher: Out<'_, Option<Box<Publisher>>>,
) -> Status {
    call(|| {
        let place = needed(bus, "bus")?.place.clone();
        let topic = topic.needed("topic")?;
        let name = result_type.needed("result_type")?;
        let publisher = needed(publisher, "publisher")?;
        let kind = ResultType::from_name(name);
        let kind = named(kind, "type of results", name, &ResultType::names())?;
        let about = match about.read("about")? {
            None => About::default(),
            Some(text) => serde_json::from_str(text).map_err(|fault| {
                let sentence = format!("the description cannot be read: {fault}");
                Failure::new(Status::Argument, sentence)
            })?,
        };
        let spec = ResultTopic {
            about,
            ..ResultTopic::new(kind)
        };
        let port = Arc::new(place.bus.result_publisher(topic, &spec)?);
        Ok(hand_over(publisher, Publisher { port, place }))
    })
}

/// Closes the topic, once its last loan is gone.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_publisher_close(publisher: Option<Box<Publisher>>) {
    ask((), || drop(publisher));
}

/// Number of readers now.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_publisher_readers(publisher: Option<&Publisher>) -> usize {
    ask(0, || publisher.map_or(0, |it| it.port.n_readers()))
}

/// Loans room for a body.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_publisher_loan(
    publisher: Option<&Publisher>,
    body_bytes: usize,
    loan: Out<'_, Option<Box<Loan>>>,
) -> Status {
    call(|| {
        let publisher = needed(publisher, "publisher")?;
        let loan = needed(loan, "loan")?;
        let made = Loan {
            loan: publisher.port.loan(body_bytes)?,
            _port: publisher.port.clone(),
            _place: publisher.place.clone(),
        };
        Ok(hand_over(loan, made))
    })
}

/// The room for the body, where it lies in shared memory.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_loan_body(loan: Option<&mut Loan>, room_bytes: Out<'_, usize>) -> *mut u8 {
    ask(null_mut(), || {
        if let Some(room) = room_bytes {
            room.write(loan.as_ref().map_or(0, |it| it.loan.room()));
        }
        loan.map_or(null_mut(), |it| it.loan.body_ptr())
    })
}

/// The header, for what the inputs do not say.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_loan_header(loan: Option<&mut Loan>) -> *mut ResultHeader {
    ask(null_mut(), || {
        loan.map_or(null_mut(), |it| std::ptr::from_mut(it.loan.header_mut()))
    })
}

/// Says that the body is a list of records, and behind them a tail.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_loan_set_list(
    loan: Option<&mut Loan>,
    n_items: u32,
    element_bytes: u32,
    tail_bytes: u64,
) -> Status {
    call(|| {
        let loan = &mut needed(loan, "loan")?.loan;
        loan.set_list(n_items, element_bytes, tail_bytes)?;
        Ok(Status::Ok)
    })
}

/// Says that the body is an image.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_loan_set_image(
    loan: Option<&mut Loan>,
    width_px: u32,
    height_px: u32,
    pixel_format: Text<'_>,
) -> Status {
    call(|| {
        let loan = &mut needed(loan, "loan")?.loan;
        let name = pixel_format.needed("pixel_format")?;
        let all: Vec<_> = PixelFormat::ALL.iter().map(|it| it.name()).collect();
        let format = PixelFormat::from_name(name);
        let format = named(format, "pixel format", name, &all.join(", "))?;
        let row_bytes = u64::from(width_px) * format.element_bytes() as u64;
        if u32::try_from(row_bytes).is_err() {
            return Err(Failure::new(
                Status::Argument,
                format!(
                    "a row of {width_px} pixels has {row_bytes} bytes, at most {} fit into a header",
                    u32::MAX
                ),
            ));
        }
        loan.set_image(width_px, height_px, format)?;
        Ok(Status::Ok)
    })
}

/// Says that the body is a tensor.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_loan_set_tensor(
    loan: Option<&mut Loan>,
    element_type: Text<'_>,
    sizes: List<'_, u32>,
    n_dims: usize,
) -> Status {
    call(|| {
        let loan = &mut needed(loan, "loan")?.loan;
        let name = element_type.needed("element_type")?;
        let all: Vec<_> = ElementType::ALL.iter().map(|it| it.name()).collect();
        let element = ElementType::from_name(name);
        let element = named(element, "type of elements", name, &all.join(", "))?;
        loan.set_tensor(element, sizes.read(n_dims, "sizes")?)?;
        Ok(Status::Ok)
    })
}

/// Names a frame or a result that this result was computed from.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_loan_answers(loan: Option<&mut Loan>, input: Option<&Sample>) -> Status {
    call(|| {
        let loan = needed(loan, "loan")?;
        loan.loan.answers(needed(input, "input")?.answerable());
        Ok(Status::Ok)
    })
}

/// Sends the result, and ends the loan.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_loan_send(loan: Option<Box<Loan>>, n_readers: Out<'_, usize>) -> Status {
    call(|| {
        let Loan {
            loan,
            _port,
            _place,
        } = *needed(loan, "loan")?;
        let n = loan.send()?;
        if let Some(n_readers) = n_readers {
            n_readers.write(n);
        }
        Ok(Status::Ok)
    })
}

/// Gives the room back unsent.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_loan_drop(loan: Option<Box<Loan>>) {
    ask((), || drop(loan));
}

const _: () = {
    const fn moves<T: Send>() {}
    moves::<Publisher>();
    moves::<Loan>();
};
