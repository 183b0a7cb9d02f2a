#pragma once

#include <string>
#include <vector>

#include "examples/slide_run/job.h"

namespace slide::run {

/// Prints how far a job is: a bar on a terminal, one line per stage elsewhere, nothing if quiet. To standard
/// error, so that frames can go to standard output.
class ProgressDisplay {
 public:
  explicit ProgressDisplay(bool quiet);
  ~ProgressDisplay();
  ProgressDisplay(const ProgressDisplay&) = delete;
  ProgressDisplay& operator=(const ProgressDisplay&) = delete;
  void show(const std::string& stage, double part);
  /// Ends the bar's line.
  void clear();

 private:
  bool quiet_;
  bool terminal_;
  std::string stage_;
  int percent_ = -1;
};

/// What was made, how long each stage took, and what to try next.
void print_summary(const JobReport& report, bool explain);

/// All reports as one JSON document on standard output.
void print_json(const std::vector<JobReport>& reports);

/// The largest amount of memory this process has held, bytes.
[[nodiscard]] std::size_t peak_memory();

}  // namespace slide::run
