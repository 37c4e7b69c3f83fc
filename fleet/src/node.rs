//! The one operator of a fleet's plans: recordings go in, what became of them comes out.
//!
//! It is unary on purpose. Its input is a table in memory with a partition for each task, and Ballista hands
//! the partitions out one by one. An operator without input would be run as a whole by every task.

use crate::run_dir::RunDir;
use crate::worker::{Task, Worker};
use ballista_core::execution_plans::ShuffleWriterExec;
use datafusion::arrow::array::{ArrayRef, AsArray, RecordBatch, StringArray};
use datafusion::arrow::datatypes::{DataType, Field, Schema, SchemaRef};
use datafusion::catalog::memory::{DataSourceExec, MemorySourceConfig};
use datafusion::common::tree_node::TreeNodeRecursion;
use datafusion::error::{DataFusionError, Result};
use datafusion::execution::{SendableRecordBatchStream, TaskContext};
use datafusion::physical_expr::{EquivalenceProperties, PhysicalExpr};
use datafusion::physical_plan::stream::RecordBatchStreamAdapter;
use datafusion::physical_plan::{DisplayAs, DisplayFormatType, ExecutionPlan, PlanProperties};
use futures::{TryStreamExt, stream};
use std::fmt;
use std::sync::Arc;

/// Judges the recordings that its input names.
#[derive(Debug)]
pub struct JudgeNode {
    input: Arc<dyn ExecutionPlan>,
    /// The directory of the run that they belong to.
    pub run: RunDir,
    /// Judges recordings. Only an executor has one; scheduler and client just hand the plan on.
    worker: Option<Arc<Worker>>,
    properties: Arc<PlanProperties>,
}

/// One column of text: tasks on the way in, outcomes on the way out.
fn schema() -> SchemaRef {
    Arc::new(Schema::new(vec![Field::new("recordings", DataType::Utf8, false)]))
}

/// Rows of that column.
fn batch(rows: Vec<String>) -> Result<RecordBatch> {
    let column: ArrayRef = Arc::new(StringArray::from(rows));
    Ok(RecordBatch::try_new(schema(), vec![column])?)
}

/// The plan of a job, with a partition for each task.
pub fn plan(run: RunDir, tasks: &[Task]) -> Result<Arc<dyn ExecutionPlan>> {
    let text = |task: &Task| {
        serde_json::to_string(task).map_err(|e| DataFusionError::External(Box::new(e)))
    };
    let partitions: Vec<Vec<RecordBatch>> =
        tasks.iter().map(|task| Ok(vec![batch(vec![text(task)?])?])).collect::<Result<_>>()?;
    let input = MemorySourceConfig::try_new_exec(&partitions, schema(), None)?;
    Ok(Arc::new(JudgeNode::new(input, run, None)))
}

/// Whether a plan, or a stage of it, is one of the fleet and nothing else: recordings from memory that are
/// judged. Any other plan may read and write what it likes.
pub fn is_ours(plan: &Arc<dyn ExecutionPlan>) -> bool {
    let plan = match (plan.downcast_ref::<ShuffleWriterExec>(), plan.children().as_slice()) {
        (Some(_), [stage]) => *stage,
        _ => plan,
    };
    let Some(judge) = plan.downcast_ref::<JudgeNode>() else { return false };
    let source = judge.input.downcast_ref::<DataSourceExec>();
    source.is_some_and(|of| of.data_source().downcast_ref::<MemorySourceConfig>().is_some())
}

/// The error for any other plan.
pub fn not_ours() -> DataFusionError {
    DataFusionError::Plan("not a plan of inkling-fleet: nothing else is run here".into())
}

impl JudgeNode {
    pub fn new(
        input: Arc<dyn ExecutionPlan>,
        run: RunDir,
        worker: Option<Arc<Worker>>,
    ) -> JudgeNode {
        let of = input.properties();
        let properties = Arc::new(PlanProperties::new(
            EquivalenceProperties::new(schema()),
            of.partitioning.clone(),
            of.emission_type,
            of.boundedness,
        ));
        JudgeNode { input, run, worker, properties }
    }
}

impl DisplayAs for JudgeNode {
    fn fmt_as(&self, _: DisplayFormatType, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "JudgeNode: run={}", self.run.path().display())
    }
}

impl ExecutionPlan for JudgeNode {
    fn name(&self) -> &str {
        "JudgeNode"
    }

    /// Partitions and order are those of the input.
    fn properties(&self) -> &Arc<PlanProperties> {
        &self.properties
    }

    fn children(&self) -> Vec<&Arc<dyn ExecutionPlan>> {
        vec![&self.input]
    }

    /// A partition is a task. If the engine repartitioned the input, it would make tasks that judge nothing.
    fn benefits_from_input_partitioning(&self) -> Vec<bool> {
        vec![false]
    }

    /// The operator computes no expressions.
    fn apply_expressions(
        &self,
        _: &mut dyn FnMut(&Arc<dyn PhysicalExpr>) -> Result<TreeNodeRecursion>,
    ) -> Result<TreeNodeRecursion> {
        Ok(TreeNodeRecursion::Continue)
    }

    /// The same operator on another input; the engine asks for it when it splits a plan into stages.
    fn with_new_children(
        self: Arc<Self>,
        children: Vec<Arc<dyn ExecutionPlan>>,
    ) -> Result<Arc<dyn ExecutionPlan>> {
        match <[_; 1]>::try_from(children) {
            Ok([input]) => {
                Ok(Arc::new(JudgeNode::new(input, self.run.clone(), self.worker.clone())))
            }
            Err(_) => Err(DataFusionError::Plan("recordings come from one place".into())),
        }
    }

    /// Judges the tasks of a partition. What goes wrong with a recording is said in its row; an error here
    /// ends the job.
    fn execute(
        &self,
        partition: usize,
        context: Arc<TaskContext>,
    ) -> Result<SendableRecordBatchStream> {
        let Some(worker) = self.worker.clone() else {
            return Err(DataFusionError::Plan("only an inkling-fleet executor judges".into()));
        };
        let (input, run) = (self.input.execute(partition, context)?, self.run.clone());
        let judged = input.and_then(move |tasks| {
            let (worker, run) = (worker.clone(), run.clone());
            async move {
                // hours of computing must not occupy the threads that talk to the scheduler
                tokio::task::spawn_blocking(move || judge(&worker, &run, &tasks))
                    .await
                    .map_err(|e| DataFusionError::Execution(format!("{e}; this is our bug")))?
            }
        });
        let judged: stream::BoxStream<_> = Box::pin(judged);
        Ok(Box::pin(RecordBatchStreamAdapter::new(schema(), judged)))
    }
}

/// Judges the tasks in a batch, and gives their outcomes.
fn judge(worker: &Worker, run: &RunDir, tasks: &RecordBatch) -> Result<RecordBatch> {
    let mut outcomes = Vec::new();
    for text in tasks.column(0).as_string::<i32>().iter().flatten() {
        let task: Task = serde_json::from_str(text)
            .map_err(|e| DataFusionError::Execution(format!("a task cannot be read: {e}")))?;
        let ended = worker.judge(run, &task).map_err(DataFusionError::Execution)?;
        outcomes.extend(ended);
    }
    batch(outcomes)
}
