//! Who may talk to a scheduler: on loopback any process of this machine, elsewhere whoever has a certificate
//! of the fleet's own authority (mutual TLS). Executors listen to nobody.

use ballista_core::extension::EndpointOverrideFn;
use std::net::{SocketAddr, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use tonic::transport::{Certificate, ClientTlsConfig, Endpoint, Identity, ServerTlsConfig};

#[derive(Clone, Debug, clap::Args)]
pub struct TlsArgs {
    /// The fleet's authority: certificates that it signed are believed, no others; PEM
    #[arg(long, value_name = "FILE", requires_all = ["tls_cert", "tls_key"])]
    tls_ca: Option<PathBuf>,
    /// This process's certificate, signed by it; PEM
    #[arg(long, value_name = "FILE", requires = "tls_ca")]
    tls_cert: Option<PathBuf>,
    /// The certificate's private key; PEM
    #[arg(long, value_name = "FILE", requires = "tls_ca")]
    tls_key: Option<PathBuf>,
}

/// Mutual TLS: both sides show a certificate, and both must be signed by the authority.
#[derive(Clone, Debug)]
pub struct Tls {
    authority: Certificate,
    identity: Identity,
}

impl TlsArgs {
    /// Reads the files. `None`: none were given, so connections are not encrypted.
    pub fn load(&self) -> Result<Option<Tls>, String> {
        let (Some(ca), Some(cert), Some(key)) = (&self.tls_ca, &self.tls_cert, &self.tls_key)
        else {
            return Ok(None);
        };
        let read = |path: &Path| {
            std::fs::read(path).map_err(|e| format!("{}: cannot be read: {e}", path.display()))
        };
        let authority = Certificate::from_pem(read(ca)?);
        Ok(Some(Tls { authority, identity: Identity::from_pem(read(cert)?, read(key)?) }))
    }
}

impl Tls {
    /// TLS for a scheduler.
    pub fn server(&self) -> ServerTlsConfig {
        ServerTlsConfig::new()
            .identity(self.identity.clone())
            .client_ca_root(self.authority.clone())
    }

    /// TLS for whoever calls a scheduler; its certificate must be for this host.
    fn client(&self, host: &str) -> ClientTlsConfig {
        ClientTlsConfig::new()
            .ca_certificate(self.authority.clone())
            .identity(self.identity.clone())
            .domain_name(host)
    }
}

/// Where the scheduler is, and how it is spoken to.
#[derive(Clone, Debug)]
pub struct Scheduler {
    pub host: String,
    pub port: u16,
    tls: Option<Tls>,
}

impl Scheduler {
    /// `at` is HOST:PORT; anything else is an error.
    pub fn new(at: &str, tls: Option<Tls>) -> Result<Scheduler, String> {
        // the last colon, since an IPv6 address has several
        let parts = at.rsplit_once(':').and_then(|(host, port)| Some((host, port.parse().ok()?)));
        match parts {
            Some((host, port)) if !host.is_empty() && !host.contains('/') => {
                Ok(Scheduler { host: host.into(), port, tls })
            }
            _ => Err(format!("{at}: not HOST:PORT")),
        }
    }

    /// A warning to show before anything is sent: the connection to another machine is not encrypted. `None`:
    /// nothing to warn of.
    pub fn warning(&self) -> Option<String> {
        let in_the_clear = self.tls.is_none() && !is_loopback(&self.host, self.port);
        in_the_clear.then(|| {
            let host = &self.host;
            format!(
                "warning: {host} is another machine, and without --tls-ca, --tls-cert and --tls-key whoever \
                 can reach it can read along and give orders: use a tunnel, or certificates"
            )
        })
    }

    /// How to connect to it.
    pub fn endpoint(&self) -> Result<Endpoint, String> {
        let scheme = if self.tls.is_some() { "https" } else { "http" };
        let failed = |e: tonic::transport::Error| format!("{}:{}: {e}", self.host, self.port);
        let endpoint = Endpoint::from_shared(format!("{scheme}://{}:{}", self.host, self.port))
            .map_err(failed)?
            .connect_timeout(Duration::from_secs(10))
            .timeout(Duration::from_secs(60))
            .tcp_nodelay(true)
            // a dead connection is noticed within a minute even if nothing is sent
            .http2_keep_alive_interval(Duration::from_secs(30))
            .keep_alive_timeout(Duration::from_secs(20))
            .keep_alive_while_idle(true);
        match &self.tls {
            None => Ok(endpoint),
            Some(tls) => endpoint.tls_config(tls.client(&self.host)).map_err(failed),
        }
    }

    /// The same for Ballista's executor, which would otherwise connect without certificates.
    pub fn endpoint_override(&self) -> EndpointOverrideFn {
        let scheduler = self.clone();
        Arc::new(move |_| scheduler.endpoint().map_err(Into::into))
    }
}

/// The address that HOST:PORT means; an error in words.
pub fn address(at: &str) -> Result<SocketAddr, String> {
    let mut found = at.to_socket_addrs().map_err(|e| format!("not HOST:PORT: {e}"))?;
    found.next().ok_or_else(|| "there is no such host".to_owned())
}

/// Whether all addresses of a host are of this machine.
fn is_loopback(host: &str, port: u16) -> bool {
    let addresses = (host.trim_matches(['[', ']']), port).to_socket_addrs();
    addresses.is_ok_and(|mut all| all.all(|address| address.ip().is_loopback()))
}

/// Whether a scheduler may listen at an address. `Ok` has a warning to show first, if there is one.
pub fn may_bind(
    address: SocketAddr,
    tls: Option<&Tls>,
    insecure: bool,
) -> Result<Option<String>, String> {
    if tls.is_some() || address.ip().is_loopback() {
        return Ok(None);
    }
    let danger = format!(
        "{address} can be reached from other machines, and without certificates whoever reaches it can have \
         any recording under the executors' roots judged, and results there replaced"
    );
    match insecure {
        true => Ok(Some(format!("warning: {danger}"))),
        false => Err(format!(
            "{danger}: give --tls-ca, --tls-cert and --tls-key, or --insecure where a tunnel or a network \
             policy keeps others away"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_loopback_goes_without_certificates_and_a_warning() {
        let at = |text: &str| text.parse::<SocketAddr>().unwrap();
        for here in ["127.0.0.1:0", "127.8.8.8:1", "[::1]:50050"] {
            assert_eq!(may_bind(at(here), None, false), Ok(None), "{here}");
        }
        for reachable in ["0.0.0.0:50050", "[::]:50050", "192.0.2.7:1"] {
            assert!(may_bind(at(reachable), None, false).unwrap_err().contains("--tls-ca"));
            let warned = may_bind(at(reachable), None, true).unwrap().unwrap();
            assert!(warned.starts_with("warning: "), "{warned}");
        }
        let of = |at: &str| Scheduler::new(at, None).map(|scheduler| scheduler.warning());
        assert_eq!(of("127.0.0.1:50050"), Ok(None));
        assert!(of("192.0.2.7:50050").unwrap().is_some());
        for wrong in ["", "host", ":1", "host:port", "host:70000", "http://127.0.0.1:50050"] {
            assert!(of(wrong).is_err(), "{wrong}");
        }
    }
}
