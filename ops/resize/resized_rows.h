#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "ops/common/elements.h"
#include "ops/resize/resize_op.h"
#include "ops/resize/resize_routines.h"

namespace slide::ops {

/// How planes of one size are resampled to another, with tables in the order in which the routines read them.
struct ResizeTables {
  ResizeTables(const ResizeOp& op, std::int64_t height, std::int64_t width);

  std::int64_t in_width, out_width;
  ResizeAxis rows;
  std::vector<std::int32_t> column_index;
  std::vector<float> column_weight;
};

/// The resampled rows of one plane, for who asks for them one after the other. Rows are resampled along their
/// length first, each once for a run of output rows that need it: input rows that follow each other are kept
/// in as many slots as there are taps, row r in slot r mod taps.
class ResizedRows {
 public:
  /// All are kept by reference.
  ResizedRows(const ResizeRoutines& routines, const ResizeTables& tables, const float* plane);
  /// Row i, plus the residual unless that is null, written to y.
  void write(std::int64_t i, float* y, const float* residual = nullptr);

 private:
  [[nodiscard]] const float* along(std::int64_t row);

  const ResizeRoutines& routines_;
  const ResizeTables& tables_;
  const float* plane_;
  std::vector<float> memory_;
  std::array<std::int64_t, 4> held_;
};

/// All planes of x, plus the residual unless that is null, written to y.
void resize_planes(const ResizeRoutines& routines, const ResizeOp& op, const Nchw& in, const float* x,
                   const float* residual, float* y);

}  // namespace slide::ops
