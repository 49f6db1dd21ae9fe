var<workgroup> sums: array<u32, SUM_LANES>;

// Sum of the values of the lanes up to and including this one.
fn sum_up_to(lane: u32, value: u32) -> u32 {
    sums[lane] = value;
    workgroupBarrier();
    for (var step = 1u; step < SUM_LANES; step *= 2u) {
        var before = 0u;
        if (lane >= step) {
            before = sums[lane - step];
        }
        workgroupBarrier();
        sums[lane] += before;
        workgroupBarrier();
    }
    return sums[lane];
}
