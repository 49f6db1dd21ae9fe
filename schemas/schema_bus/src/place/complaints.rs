//! Complaints about other processes: each is said once, all are counted. A process that sends
//! thousands of broken samples a second must not fill the log as well.

use std::collections::BTreeSet;

use crate::contract::origin::Origin;

/// Most pairs of process and fault that are said; beyond that faults are only counted.
const MAX_SAID: usize = 256;

/// What was complained about so far.
#[derive(Debug, Default)]
pub struct Complaints {
    said: BTreeSet<(Option<u32>, &'static str)>,
    n: u64,
}

impl Complaints {
    /// Counts a fault. Returns whether it is the first of its kind from this process, which is then
    /// to be said.
    pub fn count(&mut self, origin: &Origin, fault: &'static str) -> bool {
        self.n += 1;
        self.said.len() < MAX_SAID && self.said.insert((origin.pid, fault))
    }

    /// Number of faults, said or not.
    pub fn n(&self) -> u64 {
        self.n
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_process_is_named_once_per_fault_and_the_list_is_bounded() {
        let process = |pid| Origin {
            pid: Some(pid),
            ..Origin::default()
        };
        let mut complaints = Complaints::default();
        assert!(complaints.count(&process(1), "floods"));
        assert!(!complaints.count(&process(1), "floods"));
        assert!(complaints.count(&process(1), "lies"));
        assert!(complaints.count(&process(2), "floods"));
        assert_eq!(complaints.n(), 4);
        let said = (0..10_000).filter(|pid| complaints.count(&process(*pid), "x"));
        assert_eq!(said.count(), MAX_SAID - 3);
        assert_eq!(complaints.n(), 10_004);
    }
}
