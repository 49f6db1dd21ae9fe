//! Who renders what: shares by cost.

use std::collections::BTreeMap;

/// Cameras that stay together, because they see the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Group {
    /// Pixels times modalities.
    pub cost: u64,
    /// The worker that has it now.
    pub now: Option<u32>,
}

/// A move must make the greatest load smaller by this share of it: whoever moves forgets what it
/// saw.
const WORTH: f64 = 0.1;

/// The worker of each group, given the workers by number with the weights of their shares; `None`
/// if there are no workers.
///
/// Who has a group keeps it unless loads are uneven. The answer follows from the arguments alone.
pub fn divide(groups: &[Group], workers: &[(u32, f64)]) -> Vec<Option<u32>> {
    let weights: BTreeMap<u32, f64> = workers.iter().copied().collect();
    let mut loads: BTreeMap<u32, f64> = weights.keys().map(|worker| (*worker, 0.0)).collect();
    let load = |group: &Group, worker: u32| group.cost as f64 / weights[&worker];
    let mut owners: Vec<Option<u32>> = groups
        .iter()
        .map(|group| group.now.filter(|worker| weights.contains_key(worker)))
        .collect();
    for (group, owner) in groups.iter().zip(&owners) {
        if let Some(owner) = owner {
            *loads.entry(*owner).or_default() += load(group, *owner);
        }
    }
    let mut left: Vec<usize> = (0..groups.len())
        .filter(|idx| owners[*idx].is_none())
        .collect();
    left.sort_by_key(|idx| std::cmp::Reverse(groups[*idx].cost));
    for idx in left {
        let then = |worker: &u32| loads[worker] + load(&groups[idx], *worker);
        let Some(least) = least_by(loads.keys().copied(), then) else {
            return owners;
        };
        owners[idx] = Some(least);
        *loads.entry(least).or_default() += load(&groups[idx], least);
    }
    // Every move makes the greatest load smaller, so this ends; the bound is for rounding.
    for _ in 0..groups.len() * 2 {
        let Some((&from, &most)) = loads.iter().max_by(|a, b| a.1.total_cmp(b.1)) else {
            break;
        };
        let of_from = (0..groups.len()).filter(|idx| owners[*idx] == Some(from));
        let moves: Vec<(usize, u32)> = of_from
            .flat_map(|idx| weights.keys().map(move |to| (idx, *to)))
            .filter(|(_, to)| *to != from)
            .collect();
        let after = |(idx, to): &(usize, u32)| {
            let left = most - load(&groups[*idx], from);
            left.max(loads[to] + load(&groups[*idx], *to))
        };
        let Some((idx, to)) = least_by(moves.into_iter(), after) else {
            break;
        };
        if after(&(idx, to)) > (1.0 - WORTH) * most {
            break;
        }
        *loads.entry(from).or_default() -= load(&groups[idx], from);
        *loads.entry(to).or_default() += load(&groups[idx], to);
        owners[idx] = Some(to);
    }
    owners
}

/// The first of those for which `size` is least.
fn least_by<T>(all: impl Iterator<Item = T>, size: impl Fn(&T) -> f64) -> Option<T> {
    let mut least: Option<(f64, T)> = None;
    for one in all {
        let of_one = size(&one);
        if least
            .as_ref()
            .is_none_or(|(of_least, _)| of_one < *of_least)
        {
            least = Some((of_one, one));
        }
    }
    least.map(|(_, one)| one)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shares(costs: &[u64], workers: &[(u32, f64)]) -> Vec<Group> {
        let groups: Vec<Group> = costs
            .iter()
            .map(|cost| Group {
                cost: *cost,
                now: None,
            })
            .collect();
        moved(&groups, workers)
    }

    fn moved(groups: &[Group], workers: &[(u32, f64)]) -> Vec<Group> {
        let owners = divide(groups, workers);
        groups
            .iter()
            .zip(owners)
            .map(|(group, now)| Group { now, ..*group })
            .collect()
    }

    fn load(groups: &[Group], worker: u32) -> u64 {
        let own = groups.iter().filter(|group| group.now == Some(worker));
        own.map(|group| group.cost).sum()
    }

    #[test]
    fn shares_are_even_by_cost_and_by_weight() {
        let even = shares(&[4, 3, 3, 2, 2, 2], &[(1, 1.0), (2, 1.0)]);
        assert_eq!((load(&even, 1), load(&even, 2)), (8, 8));
        let uneven = shares(&[1; 30], &[(4, 1.0), (9, 2.0)]);
        assert_eq!((load(&uneven, 4), load(&uneven, 9)), (10, 20));
        assert_eq!(divide(&even, &[]), [None; 6]);
        assert!(divide(&[], &[(1, 1.0)]).is_empty());
    }

    #[test]
    fn who_comes_gets_a_share_and_who_goes_leaves_the_others_theirs() {
        let one = shares(&[1; 8], &[(1, 1.0)]);
        assert_eq!(load(&one, 1), 8);
        let two = moved(&one, &[(1, 1.0), (2, 1.0)]);
        assert_eq!((load(&two, 1), load(&two, 2)), (4, 4));
        let three = moved(&two, &[(1, 1.0), (2, 1.0), (3, 1.0)]);
        assert!(load(&three, 3) >= 2);
        let n_kept = |before: &[Group], after: &[Group]| {
            before
                .iter()
                .zip(after)
                .filter(|(a, b)| a.now == b.now)
                .count()
        };
        assert_eq!(n_kept(&two, &three) as u64, 8 - load(&three, 3));
        let left = moved(&three, &[(1, 1.0), (3, 1.0)]);
        let n_orphans = load(&three, 2);
        assert!(n_kept(&three, &left) as u64 >= 8 - n_orphans - 1);
        assert_eq!(load(&left, 1) + load(&left, 3), 8);
        assert!(load(&left, 1).abs_diff(load(&left, 3)) <= 1);
    }

    #[test]
    fn an_answer_follows_from_its_question() {
        let mut dice = numbers_from(7);
        for _ in 0..200 {
            let costs: Vec<u64> = (0..dice() % 20).map(|_| 1 + dice() % 100).collect();
            let workers: Vec<(u32, f64)> = (1..=1 + dice() % 5)
                .map(|number| (number as u32, 0.5 + (dice() % 4) as f64))
                .collect();
            let first = shares(&costs, &workers);
            assert_eq!(first, shares(&costs, &workers));
            assert_eq!(first, moved(&first, &workers), "nothing moves twice");
            assert!(first.iter().all(|group| group.now.is_some()));
        }
    }

    /// Numbers that follow from their start.
    fn numbers_from(mut state: u64) -> impl FnMut() -> u64 {
        move || {
            state = schema_types::noise::mix(state);
            state
        }
    }
}
