#include "ops/conv2d/conv2d.h"

#include <memory>
#include <string>

#include "ops/conv2d/conv2d_op.h"

namespace slide::ops {
namespace {

std::string pair_text(const std::array<std::int64_t, 2>& pair) {
  const std::string first = std::to_string(pair[0]);
  return pair[0] == pair[1] ? first : first + "," + std::to_string(pair[1]);
}

}  // namespace

Conv2dParams Conv2dParams::same(std::int64_t kernel, std::int64_t stride, std::int64_t dilation,
                                std::int64_t groups) {
  const std::int64_t p = dilation * (kernel - 1) / 2;
  return {{stride, stride}, {p, p, p, p}, {dilation, dilation}, groups};
}

std::string text_of(const Conv2dParams& params) {
  std::string text;
  const auto append = [&](const std::string& part) { text += (text.empty() ? "" : " ") + part; };
  if (params.stride != std::array<std::int64_t, 2>{1, 1}) append("stride " + pair_text(params.stride));
  if (params.dilation != std::array<std::int64_t, 2>{1, 1}) append("dilation " + pair_text(params.dilation));
  if (params.groups != 1) append("groups " + std::to_string(params.groups));
  if (params.padding != std::array<std::int64_t, 4>{0, 0, 0, 0}) {
    std::string sides;
    for (const std::int64_t p : params.padding) sides += (sides.empty() ? "" : ",") + std::to_string(p);
    append("padding " + sides);
  }
  return text;
}

Value conv2d(Value x, Value weight, std::optional<Value> bias, const Conv2dParams& params) {
  std::vector<Value> inputs{x, weight};
  if (bias) inputs.push_back(*bias);
  return x.graph().add(std::make_shared<Conv2dOp>(params), inputs);
}

}  // namespace slide::ops
