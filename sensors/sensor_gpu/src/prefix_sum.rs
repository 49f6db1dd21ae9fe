//! Prefix sums over the lanes of a workgroup, for the shaders of several crates.

/// WGSL to be put before a shader whose workgroups have `n_lanes` lanes, a power of two:
/// `sum_up_to(lane, value)` returns the sum of the values of all lanes up to and including this
/// one, and leaves every lane's sum in the workgroup's `sums`. All lanes must call it together.
///
/// ```
/// let wgsl = sensor_gpu::prefix_sum_wgsl(64);
/// assert!(wgsl.starts_with("const SUM_LANES: u32 = 64u;") && wgsl.contains("fn sum_up_to"));
/// ```
///
/// Source: Hillis and Steele, *Data Parallel Algorithms* (1986).
pub fn prefix_sum_wgsl(n_lanes: u32) -> String {
    format!(
        "const SUM_LANES: u32 = {n_lanes}u;\n{}",
        include_str!("prefix_sum.wgsl")
    )
}
