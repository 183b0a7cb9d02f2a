#include <doctest/doctest.h>

#include <set>
#include <string>

#include "ops/case_io.h"
#include "ops/check.h"
#include "runtime/cpu.h"

using namespace slide;

TEST_CASE(
    "the definitions agree with PyTorch in float64, and every kernel keeps its bound on the same calls") {
  const std::vector<std::string> files = ops::case_files(SLIDE_TEST_DATA "/operator_cases");
  CHECK(files.size() == 125);
  std::set<std::string> operators;
  for (const std::string& file : files) {
    const std::string name = file.substr(file.rfind('/') + 1);
    CAPTURE(name);
    const ops::CaseCheck result = ops::check_case(ops::read_case(file), detected_isa());
    operators.insert(result.op);
    CHECK(result.reference_error <= 1e-12);
    CHECK_FALSE(result.kernels.empty());
    for (const ops::KernelCheck& kernel : result.kernels) {
      INFO(kernel.kernel, ": ", kernel.verdict(), ", ", kernel.of_bound, " of its bound");
      CHECK(kernel.passed());
    }
  }
  CHECK(operators.size() == 44);
}
