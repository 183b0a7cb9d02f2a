#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <memory>
#include <string>
#include <string_view>

#include "graphs/slide.h"
#include "runtime/fast_executor.h"
#include "runtime/workspace.h"

namespace slide::graphs {

/// A stage's graph, fused, and what runs it.
struct PreparedStage {
  std::string key;  ///< what it was made for: stage, network, sizes, precision
  std::unique_ptr<Graph> graph;
  std::unique_ptr<FastExecutor> executor;
  StageReport report;  ///< what does not depend on a run
};

/// Prepared stages of networks, kept for the next photo of the same size. Their results share one workspace.
class PreparedStages {
 public:
  /// @param bytes  of weights that may be kept while nothing runs; 0: nothing is kept
  explicit PreparedStages(std::size_t bytes) : allowed_(bytes) {}

  /// Changes what may be kept; what was used longest ago is forgotten first.
  void allow(std::size_t bytes);
  [[nodiscard]] std::size_t kept_bytes() const noexcept;

  /// The stage of that key, or null.
  [[nodiscard]] std::shared_ptr<PreparedStage> find(const std::string& key);
  void keep(std::shared_ptr<PreparedStage> stage);
  /// For the results of one stage; common to all where stages are kept.
  [[nodiscard]] std::shared_ptr<Workspace> workspace() const;
  void release_workspace() noexcept { workspace_->release(); }

 private:
  void forget_what_is_too_much();

  std::size_t allowed_;
  std::list<std::shared_ptr<PreparedStage>> kept_;  // the last used first
  std::shared_ptr<Workspace> workspace_ = std::make_shared<Workspace>();
};

/// What the stages of one photo are made with.
struct StageContext {
  const SlideModels& models;
  const SlideOptions& options;
  PreparedStages& prepared;
};

/// Adds a stage's nodes to a graph.
using BuildStage = std::function<void(Graph&)>;

/// One stage: a graph, its weights, and what its run took.
class Stage {
 public:
  /// @param network  whose weights it has; not chosen: none, and nothing is kept
  Stage(std::string name, const StageContext& context, const NetworkChoice& network = {});

  /// Where the run lies on the stage's way, 0 to 1, for the progress callback.
  struct Part {
    double first = 0, size = 1;
  };
  /// Builds, fuses and plans the graph unless that was done for such inputs before, and runs it.
  /// @param variant  what `build` depends on beside the shapes of the inputs
  void run(const NamedTensors& inputs, const BuildStage& build, std::int64_t variant = 0, Part part = {0, 1});

  /// Prepares without running: `inputs` need shapes alone.
  void prepare(const NamedTensors& inputs, const BuildStage& build, std::int64_t variant = 0);

  /// A copy of an output: its place belongs to the next stage.
  [[nodiscard]] Tensor take(std::string_view output) const;
  [[nodiscard]] const StageReport& report() const noexcept { return report_; }

 private:
  const StageContext& context_;
  const NetworkChoice network_;
  StageReport report_;
  std::shared_ptr<PreparedStage> prepared_;
};

/// Memory and arithmetic of a stage, without running and without weights.
[[nodiscard]] PlannedStage plan_stage(std::string name, const SlideOptions& options, const BuildStage& build,
                                      const NetworkChoice& network = {});

}  // namespace slide::graphs
