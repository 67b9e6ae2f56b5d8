//! Which snapshots of a run are kept.

/// The snapshots that may go, of those taken after these cumulative timesteps: all but the `keep` last, and those of
/// stages that have ended, the last of them after `ended` timesteps.
pub fn superseded(snapshots: &[u64], keep: usize, ended: u64) -> Vec<u64> {
    let mut latest_first = snapshots.to_vec();
    latest_first.sort_unstable_by(|a, b| b.cmp(a));
    let kept = latest_first.iter().take(keep).filter(|&&timesteps| timesteps > ended).count();
    latest_first.split_off(kept)
}

#[cfg(test)]
mod tests {
    use super::superseded;

    #[test]
    fn the_last_few_are_kept() {
        assert!(superseded(&[], 2, 0).is_empty());
        assert!(superseded(&[10], 2, 0).is_empty());
        assert_eq!(superseded(&[30, 10, 20], 2, 0), [10]);
        assert_eq!(superseded(&[1, 2, 3, 4], 1, 0), [3, 2, 1]);
        assert_eq!(superseded(&[9, 10, 100], 2, 0), [9], "by number, not by name");
    }

    #[test]
    fn those_of_an_ended_stage_go() {
        assert_eq!(superseded(&[10, 20, 30], 2, 30), [30, 20, 10]);
        assert_eq!(superseded(&[10, 20, 40], 2, 30), [20, 10]);
        assert_eq!(superseded(&[40, 50, 60], 2, 30), [40]);
    }
}
