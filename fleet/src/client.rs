//! What the client of a run says to the scheduler: run this plan, how is this job, stop this job. It speaks
//! Ballista's protocol directly, because Ballista's own client would fetch results from executors, which
//! listen to nobody.

use crate::codec::Codec;
use crate::scheduler::MOST_MESSAGE_BYTES;
use crate::security::Scheduler;
use ballista_core::config::{BALLISTA_JOB_NAME, BALLISTA_SCHEDULER_MAX_PARTITIONS_PER_TASK};
use ballista_core::ids::new_instance_id;
use ballista_core::serde::protobuf::execute_query_params::Query;
use ballista_core::serde::protobuf::scheduler_grpc_client::SchedulerGrpcClient;
use ballista_core::serde::protobuf::{
    CancelJobParams, ExecuteQueryParams, GetJobStatusParams, KeyValuePair, execute_query_result,
    job_status,
};
use ballista_core::version;
use datafusion::physical_plan::ExecutionPlan;
use datafusion_proto::physical_plan::AsExecutionPlan;
use datafusion_proto::protobuf::PhysicalPlanNode;
use std::sync::Arc;
use tonic::Code;
use tonic::transport::Channel;

/// A connection to the scheduler.
pub struct Client {
    scheduler: SchedulerGrpcClient<Channel>,
}

/// What the scheduler says of a job.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum State {
    /// Waiting or running.
    Alive,
    Done,
    Failed(String),
    /// The scheduler does not know the job: it has been started anew since it took the job.
    Unknown,
}

/// Why the scheduler did not answer as asked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Trouble {
    /// It cannot be reached, and may come back.
    Away(String),
    /// It refuses, and would do so again.
    Refused(String),
}

impl From<tonic::Status> for Trouble {
    fn from(status: tonic::Status) -> Trouble {
        match status.code() {
            // these codes also stand for a connection that a certificate did not survive
            Code::Unavailable
            | Code::DeadlineExceeded
            | Code::Cancelled
            | Code::Unknown
            | Code::Internal => Trouble::Away(status.message().into()),
            _ => Trouble::Refused(status.message().into()),
        }
    }
}

impl Client {
    /// A client that connects when it first asks, and again whenever that is needed. An error: a certificate
    /// cannot be used.
    pub fn new(scheduler: &Scheduler) -> Result<Client, String> {
        let channel = scheduler.endpoint()?.connect_lazy();
        let scheduler = SchedulerGrpcClient::new(channel)
            .max_decoding_message_size(MOST_MESSAGE_BYTES as usize)
            .max_encoding_message_size(MOST_MESSAGE_BYTES as usize);
        Ok(Client { scheduler })
    }

    /// Submits a plan; gives the name by which the scheduler knows the job.
    pub async fn submit(&mut self, plan: Arc<dyn ExecutionPlan>) -> Result<String, Trouble> {
        let refused = |e: &dyn std::fmt::Display| Trouble::Refused(e.to_string());
        let mut bytes = Vec::new();
        PhysicalPlanNode::try_from_physical_plan(plan, Codec::new(None).as_ref())
            .and_then(|plan| plan.try_encode(&mut bytes))
            .map_err(|e| refused(&e))?;
        let setting =
            |key: &str, value: &str| KeyValuePair { key: key.into(), value: Some(value.into()) };
        let mut request = tonic::Request::new(ExecuteQueryParams {
            session_id: new_instance_id(),
            operation_id: new_instance_id(),
            settings: vec![
                setting(BALLISTA_JOB_NAME, "inkling"),
                // otherwise an executor takes as many recordings as it has slots as one task, and keeps them
                // until all are judged
                setting(BALLISTA_SCHEDULER_MAX_PARTITIONS_PER_TASK, "1"),
            ],
            query: Some(Query::PhysicalPlan(bytes)),
        });
        version::insert_version_header(request.metadata_mut());
        match self.scheduler.execute_query(request).await?.into_inner().result {
            Some(execute_query_result::Result::Success(taken)) => Ok(taken.job_id),
            Some(execute_query_result::Result::Failure(why)) => {
                Err(Trouble::Refused(format!("{why:?}")))
            }
            None => Err(Trouble::Refused("the scheduler's answer is empty".into())),
        }
    }

    /// How a job is.
    pub async fn state(&mut self, job: &str) -> Result<State, Trouble> {
        let asked = GetJobStatusParams { job_id: job.into() };
        let answer = self.scheduler.get_job_status(asked).await?.into_inner();
        Ok(match answer.status.and_then(|status| status.status) {
            None => State::Unknown,
            Some(job_status::Status::Queued(_) | job_status::Status::Running(_)) => State::Alive,
            Some(job_status::Status::Successful(_)) => State::Done,
            Some(job_status::Status::Failed(failed)) => State::Failed(failed.error),
        })
    }

    /// Asks the scheduler to stop a job. If it does not, nothing is lost: what is judged nevertheless is
    /// still named only once.
    pub async fn cancel(&mut self, job: &str) {
        let _ = self.scheduler.cancel_job(CancelJobParams { job_id: job.into() }).await;
    }
}
