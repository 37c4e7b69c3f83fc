//! `inkling-fleet scheduler`: Ballista's scheduler, on one port, which takes only plans of the fleet.
use crate::codec::{Codec, NoPlan, OurPlan};
use crate::security::{self, TlsArgs};
use ballista_core::config::TaskSchedulingPolicy;
use ballista_core::serde::protobuf::scheduler_grpc_server::SchedulerGrpcServer;
use ballista_scheduler::cluster::BallistaCluster;
use ballista_scheduler::config::{SchedulerConfig, TaskDistributionPolicy};
use ballista_scheduler::scheduler_process::create_scheduler;
use inkling::cli::exit::{Exit, Failure};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tonic::transport::Server;
use tonic::transport::server::TcpIncoming;

/// Most bytes of a message; a plan of ten thousand recordings takes some 10 MB.
pub const MOST_MESSAGE_BYTES: u32 = 128 << 20;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Where it listens; port 0: any free one, which it says
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:50050", value_parser = security::address)]
    bind: SocketAddr,
    #[command(flatten)]
    tls: TlsArgs,
    /// Listen to other machines without certificates: behind a tunnel or a network policy alone
    #[arg(long)]
    insecure: bool,
    /// An executor that has not been heard of for so long is taken for lost, and its recordings go to
    /// others; it tells of itself every 5 s
    #[arg(long, value_name = "SECONDS", default_value_t = 30, value_parser = clap::value_parser!(u64).range(6..=86_400))]
    executor_timeout: u64,
}

/// Serves until it is asked to end. An error, if the address is taken or may not be used without
/// certificates.
pub async fn run(args: Args) -> Result<Exit, Failure> {
    let tls = args.tls.load().map_err(Failure::new)?;
    let warning =
        security::may_bind(args.bind, tls.as_ref(), args.insecure).map_err(Failure::usage)?;
    warning.iter().for_each(|warning| eprintln!("{warning}"));
    let config = Arc::new(SchedulerConfig {
        bind_host: args.bind.ip().to_string(),
        bind_port: args.bind.port(),
        // executors ask for work, so they need not listen
        scheduling_policy: TaskSchedulingPolicy::PullStaged,
        task_distribution: TaskDistributionPolicy::Bias,
        executor_timeout_seconds: args.executor_timeout,
        // executors are looked for often enough that one is missed soon after the timeout
        expire_dead_executor_interval_seconds: (args.executor_timeout / 6).clamp(1, 15),
        no_executors_grace_period_seconds: args.executor_timeout.max(60),
        grpc_server_max_decoding_message_size: MOST_MESSAGE_BYTES,
        grpc_server_max_encoding_message_size: MOST_MESSAGE_BYTES,
        override_physical_codec: Some(Codec::new(None)),
        // the scheduler would call executors to drop a task; they notice by themselves that their run is over
        override_create_grpc_client_endpoint: Some(Arc::new(|_| {
            Err("executors listen to nobody".into())
        })),
        ..SchedulerConfig::default()
    });

    let failed = |e: &dyn std::fmt::Display| Failure::new(format!("{}: {e}", args.bind));
    let cluster = BallistaCluster::new_from_config(&config).await.map_err(|e| failed(&e))?;
    let scheduler =
        create_scheduler::<NoPlan, OurPlan>(cluster, config).await.map_err(|e| failed(&e))?;
    // only the scheduler's own service is offered: no web interface, no results
    let service = SchedulerGrpcServer::new(scheduler)
        .max_decoding_message_size(MOST_MESSAGE_BYTES as usize)
        .max_encoding_message_size(MOST_MESSAGE_BYTES as usize);

    let mut server = Server::builder()
        .http2_keepalive_interval(Some(Duration::from_secs(30)))
        .http2_keepalive_timeout(Some(Duration::from_secs(20)));
    if let Some(tls) = &tls {
        server = server.tls_config(tls.server()).map_err(|e| failed(&e))?;
    }
    let incoming = TcpIncoming::bind(args.bind).map_err(|e| failed(&e))?;
    let at = incoming.local_addr().map_err(|e| failed(&e))?;
    println!("listening on {at}");
    server
        .add_service(service)
        .serve_with_incoming_shutdown(incoming.with_nodelay(Some(true)), crate::asked_to_end())
        .await
        .map_err(|e| failed(&e))?;
    Ok(Exit::Done)
}
