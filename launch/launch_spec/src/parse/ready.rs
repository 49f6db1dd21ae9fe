//! `[process.NAME.ready]`: the sign that a process is ready.

use serde::{Deserialize, Serialize};

use crate::error::{Errors, OTHER_PLACE, Place};
use crate::fill::fill_entry;
use crate::period::Period;
use crate::process::{READY_WITHIN, Ready, ReadyWhen};
use crate::tree::Entry;

/// `[process.NAME.ready]`; exactly one of the first three is not empty.
#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlainReady {
    service: String,
    line: String,
    tcp: String,
    within: Period,
}

/// The sign; a process that takes part in lockstep needs none besides that.
pub(super) fn read(
    entry: &Entry,
    path: &str,
    takes_part: bool,
    errors: &mut Errors,
) -> Option<Ready> {
    let none = PlainReady {
        service: String::new(),
        line: String::new(),
        tcp: String::new(),
        within: READY_WITHIN,
    };
    let signs = fill_entry(&none, Some(entry), path, &[], errors);
    entry.node.table()?;
    let mut given = Vec::new();
    if !signs.service.is_empty() {
        given.push(ReadyWhen::Service(signs.service));
    }
    if !signs.line.is_empty() {
        if let Err(error) = regex::Regex::new(&signs.line) {
            let reason = error.to_string();
            let reason = reason
                .lines()
                .last()
                .unwrap_or_default()
                .trim_start_matches("error: ");
            errors.push(
                entry.node.at,
                format!(
                    "{path}.line is {:?}, which is no regular expression: {reason}",
                    signs.line
                ),
            );
        }
        given.push(ReadyWhen::Line(signs.line));
    }
    if !signs.tcp.is_empty() {
        let port = signs
            .tcp
            .rsplit_once(':')
            .filter(|(host, _)| !host.is_empty())
            .and_then(|(_, port)| port.parse::<u16>().ok());
        if port.is_none_or(|port| port == 0) {
            errors.push(
                entry.node.at,
                format!(
                    "{path}.tcp is {:?}, but must be host:port, e.g. \"127.0.0.1:2000\"",
                    signs.tcp
                ),
            );
        }
        given.push(ReadyWhen::Tcp(signs.tcp));
    }
    if given.is_empty() && takes_part {
        given.push(ReadyWhen::Lockstep);
    }
    if given.len() != 1 {
        let message = format!(
            "{path} has {} signs, but must have one of service, line, tcp",
            given.len()
        );
        match elsewhere(entry) {
            Some((key, at, other)) => errors.push_pair(
                at,
                format!(
                    "{message}: the other is at {OTHER_PLACE}; write {key} = \"\" to take that away"
                ),
                other,
            ),
            None => errors.push(entry.key_at, message),
        }
    }
    given.pop().map(|when| Ready {
        when,
        within: signs.within,
    })
}

/// Signs that two texts give: the earlier text's key, the later one's place, and the earlier one's.
fn elsewhere(entry: &Entry) -> Option<(&str, Place, Place)> {
    let mut signs: Vec<(Place, &str)> = ["service", "line", "tcp"]
        .into_iter()
        .filter_map(|key| Some((entry.node.table()?.get(key)?, key)))
        .filter(|(sign, _)| sign.node.plain().as_str() != Some(""))
        .map(|(sign, key)| (sign.node.at, key))
        .collect();
    signs.sort();
    let ((first, key), (last, _)) = (*signs.first()?, *signs.last()?);
    (first.source != last.source).then_some((key, last, first))
}
