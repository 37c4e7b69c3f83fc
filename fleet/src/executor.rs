//! `inkling-fleet executor`: asks the scheduler for recordings, judges them, and listens to nobody.
//!
//! It is Ballista's executor with three changes: it runs only plans of the fleet, it judges by the library's
//! own replay (`worker.rs`), and it does not serve results to others.

use crate::codec::Codec;
use crate::node;
use crate::roots::Roots;
use crate::scheduler::MOST_MESSAGE_BYTES;
use crate::security::{Scheduler, TlsArgs};
use crate::worker::Worker;
use ballista_core::JobId;
use ballista_core::config::TaskSchedulingPolicy;
use ballista_executor::execution_engine::{
    DefaultExecutionEngine, ExecutionEngine, QueryStageExecutor,
};
use ballista_executor::executor_process::{ExecutorProcessConfig, start_executor_process};
use datafusion::error::DataFusionError;
use datafusion::physical_plan::ExecutionPlan;
use datafusion::prelude::SessionConfig;
use inkling::cli::exit::{Exit, Failure};
use std::error::Error;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::available_parallelism;
use std::time::{Duration, Instant};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Where the scheduler listens
    #[arg(long, value_name = "HOST:PORT")]
    scheduler: String,
    /// Recordings and results below these directories or prefixes of object stores alone are read and
    /// written, whatever a job says; repeatable
    #[arg(long, value_name = "DIR", default_value = ".")]
    root: Vec<PathBuf>,
    /// Recordings at a time [default: the machine's cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    slots: Option<u16>,
    /// Workers per parallel stage of a recording [default: the cores that are there for each slot]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// So long it waits for a scheduler that is not there yet
    #[arg(long, value_name = "SECONDS", default_value_t = 60, value_parser = clap::value_parser!(u16).range(1..))]
    wait: u16,
    #[command(flatten)]
    tls: TlsArgs,
}

/// Runs only plans that are [`node::is_ours`], whatever a scheduler hands out.
struct OursAlone(DefaultExecutionEngine);

impl ExecutionEngine for OursAlone {
    /// Refuses a stage that is not of the fleet, before any of it runs.
    fn create_query_stage_exec(
        &self,
        job: JobId,
        stage: usize,
        task: usize,
        partitions: Vec<usize>,
        plan: Arc<dyn ExecutionPlan>,
        work_dir: &str,
        config: &SessionConfig,
    ) -> Result<Arc<dyn QueryStageExecutor>, DataFusionError> {
        match node::is_ours(&plan) {
            true => {
                self.0.create_query_stage_exec(job, stage, task, partitions, plan, work_dir, config)
            }
            false => Err(node::not_ours()),
        }
    }
}

/// Waits until a scheduler can be reached, for `most` at most. Ballista's own executor would wait for ever
/// and say nothing.
async fn wait_for(scheduler: &Scheduler, most: Duration) -> Result<(), Failure> {
    let began = Instant::now();
    loop {
        let endpoint = scheduler.endpoint().map_err(Failure::new)?;
        let Err(e) = endpoint.connect().await else { return Ok(()) };
        if began.elapsed() >= most {
            let why = e.source().map_or_else(|| e.to_string(), ToString::to_string);
            return Err(Failure::new(format!(
                "no scheduler at {}:{} for {} s: {why}",
                scheduler.host,
                scheduler.port,
                most.as_secs()
            )));
        }
        tokio::time::sleep(Duration::from_millis(500)).await;
    }
}

/// Runs until it is asked to end, or the scheduler is gone.
pub async fn run(args: Args) -> Result<Exit, Failure> {
    let tls = args.tls.load().map_err(Failure::new)?;
    let scheduler = Scheduler::new(&args.scheduler, tls).map_err(Failure::usage)?;
    scheduler.warning().iter().for_each(|warning| eprintln!("{warning}"));
    scheduler.endpoint().map_err(Failure::new)?; // a certificate that cannot be used is told now

    let roots = Roots::new(&args.root).map_err(|e| Failure::usage(format!("--root {e}")))?;
    let cores = available_parallelism().map_or(1, usize::from);
    let slots = args.slots.map_or(cores, usize::from);
    let threads = args.threads.map_or((cores / slots).max(1), usize::from);
    let worker = Arc::new(Worker::new(roots, threads, name()));
    // Ballista writes notes of what it ran, for which nobody asks
    let notes = tempfile::tempdir().map_err(|e| Failure::new(format!("no room for notes: {e}")))?;
    let config = ExecutorProcessConfig {
        external_host: Some(name()),
        scheduler_host: scheduler.host.clone(),
        scheduler_port: scheduler.port,
        scheduler_connect_timeout_seconds: args.wait,
        vcores: slots,
        task_scheduling_policy: TaskSchedulingPolicy::PullStaged,
        work_dir: Some(notes.path().to_string_lossy().into_owned()),
        job_data_ttl_seconds: 3600,
        job_data_clean_up_interval_seconds: 600,
        grpc_max_decoding_message_size: MOST_MESSAGE_BYTES,
        grpc_max_encoding_message_size: MOST_MESSAGE_BYTES,
        memory_pool_size: Some(0), // recordings are judged outside of it
        override_physical_codec: Some(Codec::new(Some(worker))),
        override_execution_engine: Some(Arc::new(OursAlone(DefaultExecutionEngine::new()))),
        // no results travel: there is nothing to serve
        override_arrow_flight_service: Some(Arc::new(|_, _, mut shutdown, _| {
            tokio::spawn(async move {
                shutdown.recv().await;
                Ok(())
            })
        })),
        override_create_grpc_client_endpoint: Some(scheduler.endpoint_override()),
        ..ExecutorProcessConfig::default()
    };

    wait_for(&scheduler, Duration::from_secs(args.wait.into())).await?;
    println!("asking {} for recordings, {slots} at a time", args.scheduler);
    start_executor_process(Arc::new(config))
        .await
        .map_err(|e| Failure::new(format!("{}: {e}", args.scheduler)))?;
    Ok(Exit::Done)
}

/// Host and process: the executor's name, which is a part of files' names.
fn name() -> String {
    let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let plain = |c: &char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
    let host: String = host.chars().filter(plain).take(64).collect();
    format!("{host}-{}", std::process::id())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ballista_core::execution_plans::ShuffleWriterExec;
    use datafusion::prelude::SessionContext;

    #[tokio::test]
    async fn what_a_scheduler_hands_out_beside_our_plan_is_not_run() {
        let other = SessionContext::new().sql("select 1 as a").await.unwrap();
        let other = other.create_physical_plan().await.unwrap();
        let stage = ShuffleWriterExec::try_new("job".into(), 1, other, String::new()).unwrap();
        let (stage, config) = (Arc::new(stage), SessionConfig::new());
        let run = |engine: &dyn ExecutionEngine| {
            let stage = stage.clone();
            engine.create_query_stage_exec("job".into(), 1, 0, vec![0], stage, "", &config).err()
        };
        assert!(run(&DefaultExecutionEngine::new()).is_none(), "Ballista's own runs it");
        let refused = run(&OursAlone(DefaultExecutionEngine::new())).unwrap().to_string();
        assert!(refused.contains("not a plan of inkling-fleet"), "{refused}");
    }
}
