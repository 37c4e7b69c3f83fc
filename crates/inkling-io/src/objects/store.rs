//! Finds the server and bucket that a name means, and the credentials that open it; and puts errors
//! into words without credentials.
//!
//! In: a name such as `s3://bucket/key`. Out: a [`Place`], which the rest of this directory sends
//! requests to. Without credentials `Place::of` fails at once, because the libraries would first
//! ask the network for a role of the machine. Errors of the libraries hold addresses, and those may
//! hold signatures, so every error is put into words of our own ([`failed`]).

use object_store::aws::AmazonS3Builder;
use object_store::azure::MicrosoftAzureBuilder;
use object_store::gcp::GoogleCloudStorageBuilder;
use object_store::path::Path;
use object_store::{ClientOptions, Error, ObjectStore, RetryConfig};
use std::collections::HashMap;
use std::io::{self, ErrorKind};
use std::path::Path as Name;
use std::sync::{Arc, LazyLock, Mutex, PoisonError};
use std::time::Duration;
use tokio::runtime::{Builder, Runtime};

/// The time for one request, its answer included.
const REQUEST: Duration = Duration::from_secs(60);
/// The time for a connection to the server.
const CONNECT: Duration = Duration::from_secs(5);
/// Once so much time has passed since a request's first try, a try that fails is not followed by
/// another. A try that began before may still take [`REQUEST`].
const ALL_TRIES: Duration = Duration::from_secs(90);
/// How often a request is tried again after its first try failed.
const MOST_RETRIES: usize = 4;
/// Characters of a library's error that are shown; a server may answer with a whole page.
const MOST_WORDS: usize = 300;

#[derive(Clone, Debug)]
pub struct Place {
    pub store: Arc<dyn ObjectStore>,
    pub key: Path,
    /// Scheme and bucket, such as `s3://bucket`: with `/` and a key behind, it is a full name again.
    pub root: String,
}

impl Place {
    /// The place that a name means; asks no server.
    pub fn of(name: &Name) -> io::Result<Place> {
        let text = name.to_str().ok_or_else(|| wrong("its name is not UTF-8".into()))?;
        // on Windows a path that was put together has backslashes
        let text = if cfg!(windows) { text.replace('\\', "/") } else { text.to_owned() };
        let (scheme, rest) = text.split_once("://").unwrap_or_default();
        let (bucket, key) = rest.split_once('/').unwrap_or((rest, ""));
        if bucket.is_empty() {
            return Err(wrong(format!("names no bucket: {scheme}://bucket/key")));
        }
        let key = Path::parse(key.trim_end_matches('/'));
        let key = key.map_err(|e| wrong(format!("can be no object's name: {e}")))?;
        let root = format!("{scheme}://{bucket}");
        Ok(Place { store: store(scheme, bucket, &root)?, key, root })
    }
}

/// Checks that a name is valid and that there are credentials for it; asks no server.
pub fn check(name: &Name) -> io::Result<()> {
    Place::of(name).map(drop)
}

fn wrong(what: String) -> io::Error {
    io::Error::new(ErrorKind::InvalidInput, what)
}

/// The store of a bucket. Each bucket has one for the whole process, so that connections are used again.
fn store(scheme: &str, bucket: &str, root: &str) -> io::Result<Arc<dyn ObjectStore>> {
    static STORES: LazyLock<Mutex<HashMap<String, Arc<dyn ObjectStore>>>> =
        LazyLock::new(Mutex::default);
    let mut stores = STORES.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(store) = stores.get(root) {
        return Ok(store.clone());
    }
    let store: Arc<dyn ObjectStore> = match scheme {
        "s3" | "s3a" => s3(bucket)?,
        "gs" => gcs(bucket)?,
        "az" => azure(bucket)?,
        other => return Err(wrong(format!("{other}:// is not read: write az://container/key"))),
    };
    stores.insert(root.to_owned(), store.clone());
    Ok(store)
}

fn given(variables: &[&str]) -> bool {
    variables.iter().any(|name| std::env::var_os(name).is_some_and(|value| !value.is_empty()))
}

fn no_credentials(of: &str, remedy: &str) -> io::Error {
    let what = format!("no credentials for {of}: set {remedy}");
    io::Error::new(ErrorKind::PermissionDenied, what)
}

fn retry() -> RetryConfig {
    RetryConfig { max_retries: MOST_RETRIES, retry_timeout: ALL_TRIES, ..RetryConfig::default() }
}

/// How requests are sent. `plain` allows `http://`, which a server of one's own may need.
fn client(plain: bool) -> ClientOptions {
    let agent = concat!("inkling/", env!("CARGO_PKG_VERSION"));
    ClientOptions::new()
        .with_user_agent(object_store::HeaderValue::from_static(agent))
        .with_timeout(REQUEST)
        .with_connect_timeout(CONNECT)
        .with_allow_http(plain)
}

/// Whether an endpoint that somebody set on purpose, in one of these environment variables, is `http://`.
fn plain(variables: &[&str]) -> bool {
    let plain = |name: &&str| std::env::var(name).is_ok_and(|url| url.starts_with("http://"));
    variables.iter().any(plain)
}

/// S3: credentials of the environment.
fn s3(bucket: &str) -> io::Result<Arc<dyn ObjectStore>> {
    const ANY: &[&str] = &[
        "AWS_ACCESS_KEY_ID",
        "AWS_WEB_IDENTITY_TOKEN_FILE",
        "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI",
        "AWS_CONTAINER_CREDENTIALS_FULL_URI",
        "AWS_METADATA_ENDPOINT",
        "AWS_SKIP_SIGNATURE",
    ];
    if !given(ANY) {
        let remedy = "AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY (of a profile: `aws configure export-credentials \
            --profile NAME --format env` prints the variables); on a machine with a role \
            AWS_METADATA_ENDPOINT=http://169.254.169.254; of a public bucket AWS_SKIP_SIGNATURE=true";
        return Err(no_credentials("S3", remedy));
    }
    let builder = AmazonS3Builder::from_env()
        .with_bucket_name(bucket)
        .with_retry(retry())
        .with_client_options(client(plain(&[
            "AWS_ENDPOINT_URL_S3",
            "AWS_ENDPOINT_URL",
            "AWS_ENDPOINT",
        ])));
    Ok(Arc::new(builder.build().map_err(failed)?))
}

/// Google Cloud Storage: credentials of the environment, or of a login by the command `gcloud`.
fn gcs(bucket: &str) -> io::Result<Arc<dyn ObjectStore>> {
    const ANY: &[&str] = &[
        "GOOGLE_APPLICATION_CREDENTIALS",
        "GOOGLE_SERVICE_ACCOUNT",
        "GOOGLE_SERVICE_ACCOUNT_PATH",
        "GOOGLE_SERVICE_ACCOUNT_KEY",
        "GOOGLE_SKIP_SIGNATURE",
        "SERVICE_ACCOUNT",
    ];
    let here = || std::env::home_dir().map(|home| home.join(".config/gcloud"));
    let logged_in =
        here().is_some_and(|dir| dir.join("application_default_credentials.json").is_file());
    if !given(ANY) && !logged_in {
        let remedy = "GOOGLE_APPLICATION_CREDENTIALS to a key file, or log in: gcloud auth application-default login; of a \
            public bucket GOOGLE_SKIP_SIGNATURE=true";
        return Err(no_credentials("Google Cloud Storage", remedy));
    }
    let builder = GoogleCloudStorageBuilder::from_env()
        .with_bucket_name(bucket)
        .with_retry(retry())
        .with_client_options(client(plain(&["GOOGLE_BASE_URL"])));
    Ok(Arc::new(builder.build().map_err(failed)?))
}

/// Azure Blob Storage: credentials of the environment.
fn azure(container: &str) -> io::Result<Arc<dyn ObjectStore>> {
    const ANY: &[&str] = &[
        "AZURE_STORAGE_ACCOUNT_KEY",
        "AZURE_STORAGE_ACCESS_KEY",
        "AZURE_STORAGE_SAS_TOKEN",
        "AZURE_STORAGE_SAS_KEY",
        "AZURE_STORAGE_CLIENT_ID",
        "AZURE_CLIENT_ID",
        "AZURE_FEDERATED_TOKEN_FILE",
        "AZURE_STORAGE_TOKEN",
        "AZURE_USE_AZURE_CLI",
        "AZURE_STORAGE_USE_EMULATOR",
        "AZURE_SKIP_SIGNATURE",
        "IDENTITY_ENDPOINT",
    ];
    if !given(ANY) {
        let remedy = "AZURE_STORAGE_ACCOUNT_NAME and AZURE_STORAGE_ACCOUNT_KEY (or AZURE_STORAGE_SAS_TOKEN, or \
            AZURE_USE_AZURE_CLI=true after az login)";
        return Err(no_credentials("Azure Blob Storage", remedy));
    }
    let endpoints = ["AZURE_STORAGE_ENDPOINT", "AZURE_ENDPOINT"];
    let plain = plain(&endpoints) || given(&["AZURE_STORAGE_USE_EMULATOR"]);
    let builder = MicrosoftAzureBuilder::from_env()
        .with_container_name(container)
        .with_retry(retry())
        .with_client_options(client(plain));
    Ok(Arc::new(builder.build().map_err(failed)?))
}

/// The threads of all requests. Two are enough, because they only wait for the network.
pub fn runtime() -> io::Result<&'static Runtime> {
    static RUNTIME: LazyLock<io::Result<Runtime>> =
        LazyLock::new(|| Builder::new_multi_thread().worker_threads(2).enable_all().build());
    RUNTIME.as_ref().map_err(|e| io::Error::new(e.kind(), e.to_string()))
}

/// The message if an object was changed between two requests for it.
pub const CHANGED: &str = "it was changed while it was read; replay it again";

/// An error of the crate `object_store` in words of our own: its own words may hold addresses with
/// signatures. Of most errors the crate gives no status code, so the code is read from its words.
pub fn failed(e: Error) -> io::Error {
    let text = e.to_string();
    let status = text.split("status code: ").nth(1).and_then(|s| s.split([':', ' ']).next());
    let (kind, what) = match (&e, status) {
        (Error::Precondition { .. }, _) => return io::Error::new(ErrorKind::InvalidData, CHANGED),
        (Error::NotFound { .. }, _) | (_, Some("404")) => {
            (ErrorKind::NotFound, "no such object, or no such bucket (404)".into())
        }
        (Error::PermissionDenied { .. }, _) | (_, Some("403")) => {
            let what = "access denied (403): these credentials do not allow it";
            (ErrorKind::PermissionDenied, what.into())
        }
        (Error::Unauthenticated { .. }, _) | (_, Some("401")) => {
            let what = "access denied (401): the credentials are wrong or out of date";
            (ErrorKind::PermissionDenied, what.into())
        }
        (_, Some(status)) => (ErrorKind::Other, format!("the server answers {status}")),
        (other, None) => (ErrorKind::Other, format!("the request failed: {}", root(other))),
    };
    // the server's own code, such as `SlowDown`, says more than the status
    let code = code(&text);
    let what = if code.is_empty() { what } else { format!("{what}, {code}") };
    // the crate says that it tried again; how often is set above
    let tried = kind == ErrorKind::Other && text.contains("retries");
    io::Error::new(
        kind,
        if tried { format!("{what}; tried {} times at most", MOST_RETRIES + 1) } else { what },
    )
}

/// The first cause of an error, with the queries cut from all addresses.
fn root(e: &Error) -> String {
    let mut last: &dyn std::error::Error = e;
    while let Some(source) = last.source() {
        last = source;
    }
    // a query may hold a signature
    let what = last.to_string();
    let words: Vec<&str> = what.split(' ').map(|w| w.split('?').next().unwrap_or(w)).collect();
    words.join(" ").chars().take(MOST_WORDS).collect()
}

/// The code in a server's XML answer, such as `SlowDown`: the one word of the answer that helps and
/// gives nothing away. Empty if there is none.
fn code(answer: &str) -> String {
    let code = answer.split("<Code>").nth(1).and_then(|rest| rest.split("</Code>").next());
    let word = |c: char| c.is_ascii_alphanumeric();
    code.filter(|code| code.len() < 64 && code.chars().all(word)).unwrap_or_default().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_hold_no_address_and_no_signature() {
        let said = |text: &str| {
            let source = Box::new(io::Error::other(text.to_owned()));
            failed(Error::Generic { store: "S3", source }).to_string()
        };
        let denied = said("status code: 500 Oops: <Code>Slow</Code><Key>AKIA</Key>");
        assert_eq!(denied, "the server answers 500, Slow");
        let query = said("sending to https://x/y?sig=SECRET&a=b failed");
        assert_eq!(query, "the request failed: sending to https://x/y failed");
    }

    #[test]
    fn names_that_can_be_no_objects() {
        for name in ["s3://", "s3:///key", "s3://bucket/a/../b", "abfss://c@a/b"] {
            let refused = Place::of(Name::new(name)).unwrap_err();
            assert_eq!(refused.kind(), ErrorKind::InvalidInput, "{name}: {refused}");
        }
    }
}
