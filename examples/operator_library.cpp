#include "examples/operator_library.h"

#include "runtime/error.h"

#if defined(SLIDE_LOADS_LIBRARIES)
#include <dlfcn.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "examples/c_api/slide_operator.h"
#endif

namespace slide {

#if defined(SLIDE_LOADS_LIBRARIES)
namespace {

using Function = decltype(&slide_operator);

/// A result between guards that show what is written outside of it.
class GuardedResult {
 public:
  explicit GuardedResult(std::size_t count)
      : numbers_(count + 2 * kGuards, std::numeric_limits<float>::quiet_NaN()) {}
  [[nodiscard]] std::span<float> numbers() {
    return std::span(numbers_).subspan(kGuards, numbers_.size() - 2 * kGuards);
  }
  [[nodiscard]] bool intact() const {
    const auto untouched = [](float v) { return std::isnan(v); };
    return std::all_of(numbers_.begin(), numbers_.begin() + kGuards, untouched) &&
           std::all_of(numbers_.end() - kGuards, numbers_.end(), untouched);
  }

 private:
  static constexpr std::ptrdiff_t kGuards = 64;
  std::vector<float> numbers_;
};

Function function_of(void* library, const std::string& path) {
  void* symbol = ::dlsym(library, "slide_operator");
  if (symbol == nullptr)
    throw Error(ErrorKind::kBadInput, path + ": there is no function slide_operator in it",
                "examples/c_api/slide_operator.h declares it");
  return reinterpret_cast<Function>(symbol);
}

}  // namespace

Tensor result_of_library(const std::string& path, const ops::OperatorCase& operator_case) {
  const std::string file = std::filesystem::absolute(path).string();  // a bare name would be searched for
  const std::unique_ptr<void, int (*)(void*)> library(::dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL),
                                                      ::dlclose);
  if (library == nullptr) throw Error(ErrorKind::kBadInput, path + ": it cannot be loaded: " + ::dlerror());
  const Function function = function_of(library.get(), path);
  std::vector<Tensor> values;
  for (const auto& input : operator_case.inputs) values.push_back(input.second.to(DType::kF32));
  std::vector<slide_operator_tensor> inputs;
  for (std::size_t i = 0; i < values.size(); ++i)
    inputs.push_back({operator_case.inputs[i].first.c_str(), values[i].data<float>().data(),
                      values[i].shape().extents().data(), values[i].shape().rank()});
  const Shape& shape = operator_case.expected.shape();
  GuardedResult result(static_cast<std::size_t>(shape.count()));
  const int refused = function(operator_case.op.c_str(), operator_case.attributes.c_str(), inputs.data(),
                               static_cast<std::int32_t>(inputs.size()), result.numbers().data(),
                               shape.extents().data(), shape.rank());
  if (refused != 0)
    throw Error(ErrorKind::kBadInput, path + ": slide_operator() returned " + std::to_string(refused) +
                                          " for " + operator_case.op + " " + operator_case.attributes);
  if (!result.intact())
    throw Error(ErrorKind::kBadInput, path + ": slide_operator() wrote outside of its result");
  return Tensor::from<float>(shape, std::span<const float>(result.numbers()));
}
#else
Tensor result_of_library(const std::string& path, const ops::OperatorCase& /*operator_case*/) {
  throw Error(ErrorKind::kUsage, path + ": this static program cannot load libraries",
              "build without SLIDE_STATIC, or write the result to a file for --actual");
}
#endif

}  // namespace slide
