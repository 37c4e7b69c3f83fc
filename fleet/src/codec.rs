//! How the fleet's operator travels from client to scheduler to executor, as bytes in Ballista's plans.
//! Operators of Ballista itself are left to its own codec. What is no plan of the fleet is refused here,
//! before anything runs.

use crate::node::{self, JudgeNode};
use crate::run_dir::RunDir;
use crate::worker::Worker;
use ballista_core::serde::BallistaPhysicalExtensionCodec;
use bytes::BufMut;
use datafusion::error::{DataFusionError, Result};
use datafusion::execution::TaskContext;
use datafusion::logical_expr::LogicalPlan;
use datafusion::physical_plan::ExecutionPlan;
use datafusion_proto::logical_plan::{AsLogicalPlan, LogicalExtensionCodec};
use datafusion_proto::physical_plan::{
    AsExecutionPlan, PhysicalExtensionCodec, PhysicalProtoConverterExtension,
};
use datafusion_proto::protobuf::PhysicalPlanNode;
use std::path::Path;
use std::sync::Arc;

/// Stands before the run directory in the bytes of the fleet's operator; nothing of Ballista begins so. The
/// number is the version of the format.
const OURS: &[u8] = b"\0inkling-fleet 1\0";

/// Turns operators into bytes and back.
#[derive(Debug)]
pub struct Codec {
    others: BallistaPhysicalExtensionCodec,
    /// Judges recordings; only an executor has one.
    worker: Option<Arc<Worker>>,
}

impl Codec {
    /// `worker`: that of an executor; `None` for scheduler and client, which only hand plans on.
    pub fn new(worker: Option<Arc<Worker>>) -> Arc<Codec> {
        Arc::new(Codec { others: BallistaPhysicalExtensionCodec::default(), worker })
    }
}

impl PhysicalExtensionCodec for Codec {
    /// The operator, with this executor's worker, if the bytes begin as the fleet's; else what Ballista makes
    /// of them.
    fn try_decode(
        &self,
        bytes: &[u8],
        inputs: &[Arc<dyn ExecutionPlan>],
        context: &TaskContext,
        converter: &dyn PhysicalProtoConverterExtension,
    ) -> Result<Arc<dyn ExecutionPlan>> {
        let Some(run) = bytes.strip_prefix(OURS) else {
            return self.others.try_decode(bytes, inputs, context, converter);
        };
        let malformed = || DataFusionError::Plan("not a plan of inkling-fleet".into());
        let run = std::str::from_utf8(run).map_err(|_| malformed())?;
        let [input] = inputs else { return Err(malformed()) };
        let run = RunDir::at(Path::new(run));
        Ok(Arc::new(JudgeNode::new(input.clone(), run, self.worker.clone())))
    }

    /// The fleet's operator is the path of its run; its input is encoded by the engine.
    fn try_encode(
        &self,
        node: Arc<dyn ExecutionPlan>,
        bytes: &mut Vec<u8>,
        converter: &dyn PhysicalProtoConverterExtension,
    ) -> Result<()> {
        let Some(ours) = node.downcast_ref::<JudgeNode>() else {
            return self.others.try_encode(node, bytes, converter);
        };
        let Some(run) = ours.run.path().to_str() else {
            let what = "the directory of results has a name that is no text";
            return Err(DataFusionError::Plan(what.into()));
        };
        bytes.extend_from_slice(OURS);
        bytes.extend_from_slice(run.as_bytes());
        Ok(())
    }
}

/// A plan as it travels to a scheduler. The scheduler takes only plans of the fleet.
#[derive(Clone, Debug)]
pub struct OurPlan(PhysicalPlanNode);

impl AsExecutionPlan for OurPlan {
    fn try_decode(bytes: &[u8]) -> Result<OurPlan> {
        PhysicalPlanNode::try_decode(bytes).map(OurPlan)
    }

    fn try_encode<B: BufMut>(&self, bytes: &mut B) -> Result<()> {
        self.0.try_encode(bytes)
    }

    /// The plan, if it is one of the fleet. Here the scheduler refuses all others.
    fn try_into_physical_plan(
        &self,
        context: &TaskContext,
        codec: &dyn PhysicalExtensionCodec,
    ) -> Result<Arc<dyn ExecutionPlan>> {
        let plan = self.0.try_into_physical_plan(context, codec)?;
        if node::is_ours(&plan) { Ok(plan) } else { Err(node::not_ours()) }
    }

    fn try_from_physical_plan(
        plan: Arc<dyn ExecutionPlan>,
        codec: &dyn PhysicalExtensionCodec,
    ) -> Result<OurPlan> {
        PhysicalPlanNode::try_from_physical_plan(plan, codec).map(OurPlan)
    }
}

/// A query that the scheduler would have to plan by itself. The fleet never sends one, so every one is
/// refused.
#[derive(Clone, Debug)]
pub struct NoPlan;

impl AsLogicalPlan for NoPlan {
    fn try_decode(_: &[u8]) -> Result<NoPlan> {
        Err(node::not_ours())
    }

    fn try_encode<B: BufMut>(&self, _: &mut B) -> Result<()> {
        Err(node::not_ours())
    }

    fn try_into_logical_plan(
        &self,
        _: &TaskContext,
        _: &dyn LogicalExtensionCodec,
    ) -> Result<LogicalPlan> {
        Err(node::not_ours())
    }

    fn try_from_logical_plan(_: &LogicalPlan, _: &dyn LogicalExtensionCodec) -> Result<NoPlan> {
        Err(node::not_ours())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::worker::Task;
    use ballista_core::execution_plans::ShuffleWriterExec;
    use datafusion::prelude::SessionContext;

    fn there_and_back(plan: Arc<dyn ExecutionPlan>) -> Result<Arc<dyn ExecutionPlan>> {
        let codec = Codec::new(None);
        let mut bytes = Vec::new();
        PhysicalPlanNode::try_from_physical_plan(plan, codec.as_ref())?.try_encode(&mut bytes)?;
        let context = SessionContext::new().task_ctx();
        PhysicalPlanNode::try_decode(&bytes)?.try_into_physical_plan(&context, codec.as_ref())
    }

    #[tokio::test]
    async fn ours_and_theirs_come_back_and_only_an_executor_judges() {
        let run = RunDir::at(Path::new("/srv/ünïcode/.fleet/1-2"));
        let tasks = [Task::default(), Task::default(), Task::default()];
        let plan = node::plan(run.clone(), &tasks).unwrap();
        let stage = ShuffleWriterExec::try_new("job".into(), 1, plan, String::new()).unwrap();
        let back = there_and_back(Arc::new(stage)).unwrap();
        assert!(back.downcast_ref::<ShuffleWriterExec>().is_some());
        let ours = back.children()[0].downcast_ref::<JudgeNode>().unwrap();
        assert_eq!(ours.run, run);
        assert_eq!(ours.properties().partitioning.partition_count(), 3, "a task, a partition");
        let context = SessionContext::new().task_ctx();
        let refused = ours.execute(0, context).err().unwrap().to_string();
        assert!(refused.contains("executor"), "{refused}");
    }

    /// A reader of files is Ballista's own, and comes through any codec.
    #[tokio::test]
    async fn a_scheduler_takes_our_plans_alone() {
        let codec = Codec::new(None);
        let context = SessionContext::new();
        let taken = |plan: Arc<dyn ExecutionPlan>| {
            let mut bytes = Vec::new();
            OurPlan::try_from_physical_plan(plan, codec.as_ref())?.try_encode(&mut bytes)?;
            OurPlan::try_decode(&bytes)?.try_into_physical_plan(&context.task_ctx(), codec.as_ref())
        };
        let run = RunDir::at(Path::new("/srv/.fleet/1-2"));
        let ours = node::plan(run.clone(), &[Task::default()]).unwrap();
        taken(ours.clone()).unwrap();
        assert!(node::is_ours(&ours));
        let other = context.sql("select 1 as a").await.unwrap();
        let other = other.create_physical_plan().await.unwrap();
        assert!(taken(other.clone()).unwrap_err().to_string().contains("not a plan of inkling"));
        // ours over another source, and another writer over ours
        let within: Arc<dyn ExecutionPlan> = Arc::new(JudgeNode::new(other, run, None));
        assert!(!node::is_ours(&within));
        let limited: Arc<dyn ExecutionPlan> =
            Arc::new(datafusion::physical_plan::limit::GlobalLimitExec::new(ours, 0, None));
        assert!(!node::is_ours(&limited));
        assert!(NoPlan::try_decode(&[]).is_err());
    }

    #[test]
    fn what_is_nobodys_is_refused() {
        let codec = Codec::new(None);
        let context = SessionContext::new().task_ctx();
        let converter = datafusion_proto::physical_plan::DefaultPhysicalProtoConverter {};
        for bytes in [&b"junk"[..], OURS, b"\0inkling-fleet 1\0\xff"] {
            assert!(codec.try_decode(bytes, &[], &context, &converter).is_err());
        }
    }
}
