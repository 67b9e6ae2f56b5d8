//! Orders in which n things can come.

/// How many permutations n things have, up to the largest number there is.
pub fn num_permutations(n: usize) -> u64 {
    (1..=n as u64).fold(1, u64::saturating_mul)
}

/// All n! permutations of 0 to n − 1, in lexicographic order.
pub fn permutations(n: usize) -> Vec<Vec<usize>> {
    let mut current: Vec<usize> = (0..n).collect();
    let mut all = vec![current.clone()];
    // The next one: the last place that can grow takes the next larger number, and what follows it is sorted.
    while let Some(place) = (1..n).rev().map(|after| after - 1).find(|&i| current[i] < current[i + 1]) {
        let larger = (place + 1..n).rev().find(|&i| current[i] > current[place]).unwrap_or(place + 1);
        current.swap(place, larger);
        current[place + 1..].reverse();
        all.push(current.clone());
    }
    all
}

/// The orders of a Williams design of 0 to n − 1 (Williams 1949): n orders for an even n, 2n for an odd n above 1.
///
/// Every thing stands at every place equally often, and follows every other one equally often: once for an even n, twice
/// for an odd n. So neither the place nor the predecessor is mixed up with the thing itself.
pub fn williams(n: usize) -> Vec<Vec<usize>> {
    // 0, 1, n − 1, 2, n − 2, …: its differences between neighbours are all different modulo n.
    let first: Vec<usize> = (0..n).map(|i| if i % 2 == 1 { i.div_ceil(2) } else { (n - i / 2) % n }).collect();
    let shifted = |by: usize| first.iter().map(|thing| (thing + by) % n).collect::<Vec<usize>>();
    let rows: Vec<Vec<usize>> = (0..n).map(shifted).collect();
    let mirrored = rows.iter().filter(|_| n % 2 == 1 && n > 1).map(|row| row.iter().rev().copied().collect());
    rows.iter().cloned().chain(mirrored).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use super::*;

    #[test]
    fn permutations_are_all_and_sorted() {
        assert_eq!(permutations(1), [[0]]);
        assert_eq!(permutations(3), [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]]);
        let all = permutations(5);
        assert!(all.windows(2).all(|pair| pair[0] < pair[1]));
        let is_permutation = |order: &Vec<usize>| order.iter().copied().collect::<BTreeSet<_>>() == (0..5).collect();
        assert!(all.iter().all(is_permutation));
        assert_eq!((all.len() as u64, num_permutations(5)), (120, 120));
        assert_eq!(num_permutations(60), u64::MAX);
    }

    #[test]
    fn a_williams_design_is_balanced() {
        assert_eq!(williams(1), [[0]]);
        assert_eq!(williams(4)[0], [0, 1, 3, 2]);
        for n in 2..=21 {
            let design = williams(n);
            let each = if n % 2 == 0 { 1 } else { 2 };
            assert_eq!(design.len(), each * n, "{n} things");
            let (mut places, mut neighbours) = (BTreeMap::new(), BTreeMap::new());
            for order in &design {
                assert_eq!(order.iter().copied().collect::<BTreeSet<_>>(), (0..n).collect(), "{order:?}");
                order.iter().enumerate().for_each(|at| *places.entry(at).or_insert(0) += 1);
                order.windows(2).for_each(|pair| *neighbours.entry((pair[0], pair[1])).or_insert(0) += 1);
            }
            assert!(places.len() == n * n && places.values().all(|&count| count == each), "places of {n} things");
            let pairs = neighbours.len() == n * (n - 1);
            assert!(pairs && neighbours.values().all(|&count| count == each), "neighbours of {n} things");
        }
    }
}
