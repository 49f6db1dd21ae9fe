//! What iceoryx2's errors mean on the bus: the one place that tells their variants apart.
//!
//! iceoryx2 0.10 has an error enum of its own for every kind of service and port, and each is a
//! bare name without values. What a user can act on becomes a variant of [`BusError`] or
//! [`LoanError`]; everything else becomes [`BusError::Service`] with iceoryx2's name for it.

use std::fmt::Debug;

use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::port::subscriber::SubscriberCreateError;
use iceoryx2::port::{LoanError as IceoryxLoanError, ReceiveError};
use iceoryx2::service::builder::event::{EventCreateError, EventOpenError, EventOpenOrCreateError};
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeCreateError, PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::builder::request_response::{
    RequestResponseCreateError, RequestResponseOpenError, RequestResponseOpenOrCreateError,
};
use iceoryx2::service::{ServiceDetailsError, ServiceListError};
use nix::sys::resource::{Resource, getrlimit};

use crate::contract::error::{BusError, LoanError};
use crate::contract::qos::MAX_NODES;
use crate::memory::sizes::shared_memory_free;

/// What the failure to open, make, list or look at a service means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Meaning {
    /// Nobody made the service.
    Missing,
    /// Another user owns it.
    Permission,
    /// It carries other types or attributes.
    OtherSchema,
    /// Its capacities are too small for what was asked.
    OtherCapacity,
    /// As many processes as it allows have it open.
    TooManyProcesses,
    /// Nothing that a user could act on, or that passes by itself.
    Other,
}

/// An error of iceoryx2 about a service.
pub(crate) trait ServiceFailure: Debug {
    fn meaning(&self) -> Meaning;
}

impl ServiceFailure for PublishSubscribeOpenError {
    fn meaning(&self) -> Meaning {
        match self {
            Self::DoesNotExist => Meaning::Missing,
            Self::InsufficientPermissions => Meaning::Permission,
            Self::IncompatibleTypes | Self::IncompatibleAttributes => Meaning::OtherSchema,
            Self::DoesNotSupportRequestedMinBufferSize
            | Self::DoesNotSupportRequestedMinHistorySize
            | Self::DoesNotSupportRequestedMinSubscriberBorrowedSamples
            | Self::DoesNotSupportRequestedAmountOfPublishers
            | Self::DoesNotSupportRequestedAmountOfSubscribers
            | Self::DoesNotSupportRequestedAmountOfNodes
            | Self::IncompatibleOverflowBehavior => Meaning::OtherCapacity,
            Self::ExceedsMaxNumberOfNodes => Meaning::TooManyProcesses,
            _ => Meaning::Other,
        }
    }
}

impl ServiceFailure for PublishSubscribeOpenOrCreateError {
    fn meaning(&self) -> Meaning {
        use PublishSubscribeCreateError as Create;
        match self {
            Self::PublishSubscribeOpenError(open) => open.meaning(),
            Self::PublishSubscribeCreateError(Create::InsufficientPermissions) => {
                Meaning::Permission
            }
            _ => Meaning::Other,
        }
    }
}

impl ServiceFailure for EventOpenError {
    fn meaning(&self) -> Meaning {
        match self {
            Self::DoesNotExist => Meaning::Missing,
            Self::InsufficientPermissions => Meaning::Permission,
            Self::IncompatibleAttributes => Meaning::OtherSchema,
            Self::DoesNotSupportRequestedAmountOfNotifiers
            | Self::DoesNotSupportRequestedAmountOfListeners
            | Self::DoesNotSupportRequestedMaxEventId
            | Self::DoesNotSupportRequestedAmountOfNodes => Meaning::OtherCapacity,
            Self::ExceedsMaxNumberOfNodes => Meaning::TooManyProcesses,
            _ => Meaning::Other,
        }
    }
}

impl ServiceFailure for EventOpenOrCreateError {
    fn meaning(&self) -> Meaning {
        match self {
            Self::EventOpenError(open) => open.meaning(),
            Self::EventCreateError(EventCreateError::InsufficientPermissions) => {
                Meaning::Permission
            }
            _ => Meaning::Other,
        }
    }
}

impl ServiceFailure for RequestResponseOpenError {
    fn meaning(&self) -> Meaning {
        match self {
            Self::DoesNotExist => Meaning::Missing,
            Self::InsufficientPermissions => Meaning::Permission,
            Self::IncompatibleRequestOrResponseType | Self::IncompatibleAttributes => {
                Meaning::OtherSchema
            }
            Self::DoesNotSupportRequestedAmountOfClientRequestLoans
            | Self::DoesNotSupportRequestedAmountOfActiveRequestsPerClient
            | Self::DoesNotSupportRequestedResponseBufferSize
            | Self::DoesNotSupportRequestedAmountOfServers
            | Self::DoesNotSupportRequestedAmountOfClients
            | Self::DoesNotSupportRequestedAmountOfNodes
            | Self::DoesNotSupportRequestedAmountOfBorrowedResponsesPerPendingResponse
            | Self::IncompatibleOverflowBehaviorForRequests
            | Self::IncompatibleOverflowBehaviorForResponses => Meaning::OtherCapacity,
            Self::ExceedsMaxNumberOfNodes => Meaning::TooManyProcesses,
            _ => Meaning::Other,
        }
    }
}

impl ServiceFailure for RequestResponseOpenOrCreateError {
    fn meaning(&self) -> Meaning {
        use RequestResponseCreateError as Create;
        match self {
            Self::RequestResponseOpenError(open) => open.meaning(),
            Self::RequestResponseCreateError(Create::InsufficientPermissions) => {
                Meaning::Permission
            }
            _ => Meaning::Other,
        }
    }
}

impl ServiceFailure for ServiceDetailsError {
    fn meaning(&self) -> Meaning {
        match self {
            Self::InsufficientPermissions => Meaning::Permission,
            _ => Meaning::Other,
        }
    }
}

impl ServiceFailure for ServiceListError {
    fn meaning(&self) -> Meaning {
        match self {
            Self::InsufficientPermissions => Meaning::Permission,
            Self::InternalError => Meaning::Other,
        }
    }
}

/// Tells why a service could not be opened, made, listed or looked at.
pub(crate) fn service_error(
    action: &'static str,
    service: &str,
    cause: &impl ServiceFailure,
) -> BusError {
    let name = service.to_string();
    match cause.meaning() {
        Meaning::Permission => BusError::Permission { service: name },
        Meaning::OtherSchema => BusError::SchemaSkew {
            service: name,
            theirs: "another version".into(),
            advice: "stop all processes of this domain and start again",
        },
        Meaning::TooManyProcesses => BusError::TooManyProcesses {
            service: name,
            limit: MAX_NODES,
        },
        Meaning::OtherCapacity => BusError::Capacity {
            service: name,
            cause: format!("{cause:?}"),
        },
        Meaning::Missing | Meaning::Other => other_error(action, service, cause),
    }
}

/// Tells why a writing port was refused. `limit` is the number of writers the service allows,
/// `need_bytes` the size of the segment the port would have made.
pub(crate) fn writer_error(
    service: &str,
    limit: usize,
    need_bytes: u64,
    cause: PublisherCreateError,
) -> BusError {
    let name = service.to_string();
    match cause {
        PublisherCreateError::ExceedsMaxSupportedPublishers => BusError::TooManyWriters {
            service: name,
            limit,
        },
        // iceoryx2 reports every failure to make the segment under this one name (no memory, no
        // permission, a file of the same name). Too little memory is by far the likeliest.
        PublisherCreateError::UnableToCreateDataSegment if shortage_of_files().is_none() => {
            BusError::Memory {
                service: name,
                need_bytes,
                free_bytes: shared_memory_free().unwrap_or(0),
            }
        }
        cause => other_error("write to", service, &cause),
    }
}

/// Tells why a reading port was refused. `limit` is the number of readers the service allows.
pub(crate) fn reader_error(service: &str, limit: usize, cause: SubscriberCreateError) -> BusError {
    match cause {
        SubscriberCreateError::ExceedsMaxSupportedSubscribers => BusError::TooManyReaders {
            service: service.to_string(),
            limit,
        },
        cause => other_error("read", service, &cause),
    }
}

/// Tells why no sample could be taken. `limit` is the number of samples a reader may hold.
pub(crate) fn receive_error(service: &str, limit: usize, cause: ReceiveError) -> BusError {
    match cause {
        ReceiveError::ExceedsMaxBorrows => BusError::BorrowLimit {
            service: service.to_string(),
            limit,
        },
        // The reason inside (for example missing permissions) is of a type that iceoryx2 does not
        // export, so only its name can be passed on.
        cause @ ReceiveError::ConnectionFailure(_) => other_error("read", service, &cause),
    }
}

/// Tells why `len` bytes could not be loaned from slots of `limit` bytes; `loans` is the number of
/// loans a writer may have.
pub(crate) fn loan_error(
    topic: &str,
    len: usize,
    limit: usize,
    loans: usize,
    cause: IceoryxLoanError,
) -> LoanError {
    let topic = topic.to_string();
    match cause {
        // A static segment has a slot for every loan and every reader, so both mean the same here.
        IceoryxLoanError::ExceedsMaxLoans | IceoryxLoanError::OutOfMemory => {
            LoanError::NoFreeSlot { topic, loans }
        }
        IceoryxLoanError::ExceedsMaxLoanSize => LoanError::TooLong { topic, len, limit },
        IceoryxLoanError::InternalFailure => LoanError::Failed {
            topic,
            cause: format!("{cause:?}"),
        },
    }
}

/// A failure that no sentence of ours explains, under iceoryx2's name for it.
pub(crate) fn other_error(action: &'static str, service: &str, cause: &dyn Debug) -> BusError {
    BusError::Service {
        action,
        service: service.to_string(),
        cause: with_shortage(format!("{cause:?}")),
    }
}

/// Whether a cause of [`BusError::Service`] says that another process has begun to make the service
/// and has not finished.
pub(crate) fn is_in_the_making(cause: &str) -> bool {
    cause.contains("HangsInCreation")
}

/// Whether a service could not be opened because it is marked as being removed.
pub(crate) fn is_being_removed(cause: &str) -> bool {
    cause.contains("IsMarkedForDestruction")
}

/// The cause, and a shortage of files if this process has one: iceoryx2 does not tell them apart.
pub(crate) fn with_shortage(cause: String) -> String {
    match shortage_of_files() {
        Some(shortage) => format!("{cause}: {shortage}"),
        None => cause,
    }
}

/// Files that one operation of iceoryx2 may have open at a time, beside those that stay.
const FILES_OF_AN_OPERATION: u64 = 8;

/// A sentence if this process has opened nearly as many files as it may.
fn shortage_of_files() -> Option<String> {
    let (may, _) = getrlimit(Resource::RLIMIT_NOFILE).ok()?;
    match std::fs::read_dir("/proc/self/fd") {
        Ok(open) => {
            let n = open.count() as u64;
            (n + FILES_OF_AN_OPERATION > may).then(|| {
                format!("this process has {n} files open and may have {may}; raise the limit with ulimit -n")
            })
        }
        Err(error) if error.raw_os_error() == Some(nix::errno::Errno::EMFILE as i32) => {
            Some(format!(
                "this process has all of the {may} files open that it may have; raise the limit with ulimit -n"
            ))
        }
        Err(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn services_of_every_kind_are_refused_with_the_same_sentences() {
        let topic = PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(
            PublishSubscribeOpenError::IncompatibleTypes,
        );
        let commands = RequestResponseOpenOrCreateError::RequestResponseOpenError(
            RequestResponseOpenError::IncompatibleRequestOrResponseType,
        );
        let event = EventOpenOrCreateError::EventOpenError(EventOpenError::IncompatibleAttributes);
        assert_eq!(topic.meaning(), Meaning::OtherSchema);
        assert_eq!(commands.meaning(), Meaning::OtherSchema);
        assert_eq!(event.meaning(), Meaning::OtherSchema);
        assert!(matches!(
            service_error("open", "d/ego/tick", &event),
            BusError::SchemaSkew { service, .. } if service == "d/ego/tick"
        ));
    }

    #[test]
    fn a_capacity_that_does_not_fit_is_named() {
        let cause = PublishSubscribeOpenError::DoesNotSupportRequestedAmountOfSubscribers;
        let error = service_error("open", "d/ego/front/rgb", &cause).to_string();
        assert!(
            error.contains("another capacity (DoesNotSupportRequestedAmountOfSubscribers)"),
            "{error}"
        );
    }

    #[test]
    fn what_passes_by_itself_is_not_taken_for_a_refusal() {
        let cause = PublishSubscribeOpenOrCreateError::SystemInFlux;
        assert!(matches!(
            service_error("open", "d/x", &cause),
            BusError::Service { action: "open", cause, .. } if cause == "SystemInFlux"
        ));
        let cause = EventOpenOrCreateError::EventOpenError(EventOpenError::HangsInCreation);
        assert!(matches!(
            service_error("open", "d/x", &cause),
            BusError::Service { cause, .. } if is_in_the_making(&cause)
        ));
    }

    #[test]
    fn a_writer_too_many_and_a_segment_too_large_are_told_apart() {
        let error = |cause| writer_error("d/x", 2, 10 << 20, cause);
        assert!(matches!(
            error(PublisherCreateError::ExceedsMaxSupportedPublishers),
            BusError::TooManyWriters { limit: 2, .. }
        ));
        assert!(matches!(
            error(PublisherCreateError::UnableToCreateDataSegment),
            BusError::Memory { need_bytes, .. } if need_bytes == 10 << 20
        ));
    }
}
