//! Our operator on its way from client to scheduler to executor; all others are Ballista's.

use crate::node::JudgeNode;
use crate::run_dir::RunDir;
use crate::worker::Worker;
use ballista_core::serde::BallistaPhysicalExtensionCodec;
use datafusion::error::{DataFusionError, Result};
use datafusion::execution::TaskContext;
use datafusion::physical_plan::ExecutionPlan;
use datafusion_proto::physical_plan::{PhysicalExtensionCodec, PhysicalProtoConverterExtension};
use std::path::Path;
use std::sync::Arc;

/// Before our operator's run directory; nothing of Ballista's begins so.
const OURS: &[u8] = b"\0inkling-fleet 1\0";

#[derive(Debug)]
pub struct Codec {
    others: BallistaPhysicalExtensionCodec,
    worker: Option<Arc<Worker>>,
}

impl Codec {
    /// `worker`: of an executor.
    pub fn new(worker: Option<Arc<Worker>>) -> Arc<Codec> {
        Arc::new(Codec { others: BallistaPhysicalExtensionCodec::default(), worker })
    }
}

impl PhysicalExtensionCodec for Codec {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::node;
    use crate::worker::Task;
    use ballista_core::execution_plans::ShuffleWriterExec;
    use datafusion::prelude::SessionContext;
    use datafusion_proto::physical_plan::AsExecutionPlan;
    use datafusion_proto::protobuf::PhysicalPlanNode;

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
