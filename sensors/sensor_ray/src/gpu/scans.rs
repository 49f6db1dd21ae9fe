//! Scans in flight, and their outcome.

use std::sync::Arc;

use sensor_gpu::{Direct, GpuError, HostMemory, InFlight};

/// The outcome of a scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScanOutcome {
    /// Points at the front of the place; the bytes after them have no meaning.
    pub n_points: u32,
    /// Copies made by the CPU: 0 into imported memory, else 1.
    pub cpu_copies: u32,
}

/// Scans in flight.
#[derive(Debug)]
#[must_use = "the points are there only after wait()"]
pub struct Scans<'p>(pub(super) Way<'p>);

#[derive(Debug)]
pub(super) enum Way<'p> {
    /// There were no jobs.
    None,
    /// Points are copied. By job: the number of its copy, `None` for a job without rays.
    Copied {
        copies: InFlight<'p>,
        of_jobs: Vec<Option<usize>>,
        _uploaded: Option<Arc<HostMemory>>,
    },
    /// The shader writes points and their numbers to their places.
    Direct {
        flight: Direct,
        totals: Arc<HostMemory>,
        n_jobs: usize,
    },
}

impl Scans<'_> {
    /// Waits until the points have arrived; returns one outcome per job, in order.
    ///
    /// # Errors
    /// The device was lost.
    pub fn wait(self) -> Result<Vec<ScanOutcome>, GpuError> {
        match self.0 {
            Way::None => Ok(Vec::new()),
            Way::Copied {
                copies, of_jobs, ..
            } => {
                let outcomes = copies.wait_awake()?;
                let totals = outcomes
                    .last()
                    .and_then(|outcome| outcome.mapped.as_ref())
                    .expect("the last copy is that of the totals");
                let totals: Vec<u32> = bytemuck::pod_collect_to_vec(totals.row(0));
                let scan = |(copy, n_points): (&Option<usize>, &u32)| ScanOutcome {
                    n_points: *n_points,
                    cpu_copies: copy.map_or(0, |copy| outcomes[copy].cpu_copies),
                };
                Ok(of_jobs.iter().zip(&totals).map(scan).collect())
            }
            Way::Direct {
                flight,
                totals,
                n_jobs,
            } => {
                flight.wait_awake()?;
                let mut n_points = vec![0u32; n_jobs];
                #[expect(
                    unsafe_code,
                    reason = "the GPU has written there; the block carries its proof"
                )]
                // SAFETY: the submission that wrote there is done, and the next one gets other
                // memory as long as this is held.
                unsafe {
                    totals.read(0, bytemuck::cast_slice_mut(&mut n_points))
                };
                Ok(n_points
                    .into_iter()
                    .map(|n_points| ScanOutcome {
                        n_points,
                        cpu_copies: 0,
                    })
                    .collect())
            }
        }
    }
}
