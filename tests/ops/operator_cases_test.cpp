#include <doctest/doctest.h>

#include <limits>
#include <set>
#include <string>

#include "ops/case_io.h"
#include "ops/check.h"
#include "runtime/cpu.h"

using namespace slide;

TEST_CASE(
    "the definitions agree with PyTorch in float64, and every kernel keeps its bound on the same calls") {
  const std::vector<std::string> files = ops::case_files(SLIDE_TEST_DATA "/operator_cases");
  CHECK(files.size() == 166);
  std::set<std::string> operators, methods;
  for (const std::string& file : files) {
    const std::string name = file.substr(file.rfind('/') + 1);
    CAPTURE(name);
    const ops::CaseCheck result = ops::check_case(ops::read_case(file), detected_isa());
    operators.insert(result.op);
    CHECK(result.reference_passed());
    CHECK_FALSE(result.kernels.empty());
    for (const ops::KernelCheck& kernel : result.kernels) {
      INFO(kernel.kernel, ": ", kernel.verdict(), ", ", kernel.of_bound, " of its bound");
      CHECK(kernel.passed());
      methods.insert(kernel.kernel.substr(0, kernel.kernel.rfind('.')));
    }
  }
  CHECK(operators.size() == 52);
  // All methods of convolutions but one, which needs 2^15 weights; the other operators have one each.
  for (const char* method :
       {"depthwise", "few_filters", "winograd2", "winograd4", "winograd6", "grouped_gate", "direct", "gemm",
        "winograd4_bf16", "direct_bf16", "direct_int8"})
    CHECK(methods.contains(std::string("conv2d.") + method));
}

TEST_CASE("a NaN or an infinity in any input reaches what the definition says, at every kernel") {
  std::set<std::string> operators;
  for (const char* folder : {"/operator_cases", "/onnx_cases"})
    for (const std::string& file : ops::case_files(std::string(SLIDE_TEST_DATA) + folder))
      for (const double bad :
           {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
            -std::numeric_limits<double>::infinity()}) {
        ops::OperatorCase c = ops::read_case(file);
        if (c.expected.count() > 4096) continue;  // convolutions: tests/ops/conv2d_test.cpp
        for (auto& input : c.inputs) {
          const std::string& name = input.first;
          Tensor& tensor = input.second;
          const Tensor sound = tensor;
          tensor = sound.to(DType::kF64).clone();
          tensor.mutable_data<double>()[static_cast<std::size_t>(tensor.count() * 2 / 3)] = bad;
          for (const ops::KernelCheck& kernel : ops::check_case(c, detected_isa()).kernels) {
            INFO(file, " with ", bad, " in ", name, ", ", kernel.kernel, ": ", kernel.verdict());
            CHECK(kernel.passed());
          }
          tensor = sound;
        }
        operators.insert(c.op);
      }
  CHECK(operators.size() == 53);
}

TEST_CASE("hard cases hold: large means, sums that cancel, both ends of float32's range, denormals") {
  const std::vector<std::string> files = ops::case_files(SLIDE_TEST_DATA "/hard_cases");
  CHECK(files.size() == 26);
  for (const std::string& file : files) {
    const ops::CaseCheck result = ops::check_case(ops::read_case(file), detected_isa());
    INFO(file);
    CHECK(result.reference_passed());
    CHECK_FALSE(result.kernels.empty());
    for (const ops::KernelCheck& kernel : result.kernels) {
      INFO(kernel.kernel, ": ", kernel.verdict(), ", ", kernel.of_bound, " of its bound");
      CHECK(kernel.passed());
    }
  }
}
