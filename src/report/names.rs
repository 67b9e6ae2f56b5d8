//! Names of files.

/// Longest stem of a file's name, in characters: arms that differ in many settings have long names.
const LONGEST: usize = 80;

/// A name as part of a file's name.
pub(super) fn file_name(name: &str) -> String {
    let keep = |c: char| if c.is_alphanumeric() || "-_.=".contains(c) { c } else { '_' };
    name.chars().map(keep).take(LONGEST).collect()
}

/// Numbers the names that stand more than once, so that no file replaces another.
pub(super) fn make_unique<'a>(names: impl Iterator<Item = &'a mut String>) {
    let mut taken: Vec<String> = Vec::new();
    for name in names {
        let numbered = (2..).map(|number| format!("{name}-{number}"));
        let free = std::iter::once(name.clone()).chain(numbered).find(|name| !taken.contains(name));
        *name = free.expect("there is always a next number");
        taken.push(name.clone());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_short_and_differ() {
        let arm = format!("ppo [{}]", "learning_rate=0.001, ".repeat(20));
        let mut names = [file_name(&arm), file_name(&format!("{arm}, gamma=1")), file_name("a/b (c)")];
        assert_eq!(names[0].chars().count(), LONGEST);
        make_unique(names.iter_mut());
        assert_eq!(names[1], format!("{}-2", names[0]));
        assert_eq!(names[2], "a_b__c_");
    }
}
