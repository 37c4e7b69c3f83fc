//! Reads credentials of S3 from `~/.aws/credentials` and `~/.aws/config`: key, secret, token and
//! region of the profile that `AWS_PROFILE` names, else of `default`. The crate `object_store`
//! reads only environment variables, so this file reads what the AWS tools read. `store.rs` uses it
//! where no variable gives a key. Where both files say a value, that of `credentials` holds.

use crate::regular_file;
use std::path::PathBuf;

/// A larger file counts as unreadable. Real ones have some kB.
const MOST_BYTES: u64 = 1 << 20;

/// It has no `Debug`, so that a secret cannot get into a message.
#[derive(Clone, Default, PartialEq, Eq)]
pub struct Profile {
    pub key: Option<String>,
    pub secret: Option<String>,
    pub token: Option<String>,
    pub region: Option<String>,
}

impl Profile {
    /// What the two files say of the profile. A file that is not there, or cannot be read, says nothing.
    pub fn read() -> Profile {
        let name = std::env::var("AWS_PROFILE").unwrap_or_else(|_| "default".into());
        let text = |variable: &str, beside: &str| {
            let named = std::env::var_os(variable).map(PathBuf::from);
            let path = named.or_else(|| Some(std::env::home_dir()?.join(".aws").join(beside)))?;
            regular_file::read_text(&path, MOST_BYTES).ok()
        };
        let mut profile = Profile::default();
        let config = text("AWS_CONFIG_FILE", "config").unwrap_or_default();
        let section = if name == "default" { name.clone() } else { format!("profile {name}") };
        profile.take(&config, &section);
        let credentials = text("AWS_SHARED_CREDENTIALS_FILE", "credentials").unwrap_or_default();
        profile.take(&credentials, &name);
        profile
    }

    fn take(&mut self, text: &str, section: &str) {
        let mut ours = false;
        for line in text.lines().map(str::trim) {
            if let Some(name) = line.strip_prefix('[').and_then(|l| l.strip_suffix(']')) {
                ours = name.trim() == section;
                continue;
            }
            let Some((key, value)) = line.split_once('=').filter(|_| ours) else { continue };
            let place = match key.trim() {
                "aws_access_key_id" => &mut self.key,
                "aws_secret_access_key" => &mut self.secret,
                "aws_session_token" => &mut self.token,
                "region" => &mut self.region,
                _ => continue,
            };
            *place = Some(value.trim().to_owned());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_named_section_counts_alone() {
        let text = "[default]\naws_access_key_id = A\nregion=x\n\n[other]\n# aws_access_key_id = C\n\
            aws_access_key_id=B\naws_secret_access_key = s=e\n";
        let mut profile = Profile::default();
        profile.take(text, "other");
        let (key, secret) = (Some("B".into()), Some("s=e".into()));
        assert!(profile == Profile { key, secret, ..Profile::default() });
        profile.take(text, "nobody");
        assert_eq!(profile.key.as_deref(), Some("B"));
    }
}
