#include "ops/attention/attention.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "ops/attention/attention_op.h"
#include "ops/attention/softmax_scale.h"
#include "ops/common/elements.h"

namespace slide::ops {
namespace {

/// One head's matrices, channels × positions.
struct Head {
  const double* query;
  const double* key;
  const double* value;
  std::int64_t output;  // index of its first element in the result
};

/// Calls f(head, query position) for all.
template <typename F>
void for_queries(const AttentionExtents& e, std::span<const Tensor> inputs, F f) {
  for_ranges(e.batch * e.heads * e.queries, 16, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t task = begin; task < end; ++task) {
      const std::int64_t head = task / e.queries;
      f(Head{f64(inputs[0]) + head * e.depth * e.queries, f64(inputs[1]) + head * e.depth * e.keys,
             f64(inputs[2]) + head * e.value_depth * e.keys, head * e.value_depth * e.queries},
        task % e.queries);
    }
  });
}

/// scale · sum over the channels of f(q)·f(k), for every key.
template <typename F>
std::vector<double> scores(const AttentionExtents& e, const Head& head, std::int64_t i, double scale, F f) {
  std::vector<double> s(static_cast<std::size_t>(e.keys));
  for (std::int64_t c = 0; c < e.depth; ++c)
    for (std::int64_t j = 0; j < e.keys; ++j)
      s[static_cast<std::size_t>(j)] += f(head.query[c * e.queries + i]) * f(head.key[c * e.keys + j]);
  for (double& value : s) value *= scale;
  return s;
}

std::vector<double> softmax_of(const std::vector<double>& s) {
  const double largest = *std::ranges::max_element(s);
  std::vector<double> p(s.size());
  double sum = 0;
  for (std::size_t j = 0; j < s.size(); ++j) sum += p[j] = std::exp(s[j] - largest);
  for (double& value : p) value /= sum;
  return p;
}

double itself(double x) { return x; }
double magnitude(double x) { return std::fabs(x); }

}  // namespace

std::string AttentionOp::attributes() const {
  return std::to_string(heads_) + " heads scale " + number_text(scale_);
}

AttentionExtents AttentionOp::extents(std::span<const Shape> inputs) const {
  const Nchw q = nchw(inputs[0]);
  const Nchw k = nchw(inputs[1]);
  return {q.n, heads_, q.c / heads_, inputs[2][1] / heads_, q.plane(), k.plane()};
}

Shape AttentionOp::infer(std::span<const Shape> inputs) const {
  require_input_count("attention", inputs, 3, 3);
  const Nchw q = nchw(inputs[0]);
  const Nchw k = nchw(inputs[1]);
  const Nchw v = nchw(inputs[2]);
  require_at_least("number of heads", heads_, 1);
  require(std::isfinite(scale_), "the scale is " + number_text(scale_));
  require(q.n == k.n && k.n == v.n && q.c == k.c && k.h == v.h && k.w == v.w,
          "attention cannot join queries " + inputs[0].text() + ", keys " + inputs[1].text() +
              " and values " + inputs[2].text());
  require(q.c % heads_ == 0 && v.c % heads_ == 0, "channels of " + inputs[0].text() + " and " +
                                                      inputs[2].text() + " do not divide into " +
                                                      std::to_string(heads_) + " heads");
  return {q.n, v.c, q.h, q.w};
}

void AttentionOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  const AttentionExtents e = extents({{inputs[0].shape(), inputs[1].shape(), inputs[2].shape()}});
  double* y = f64(output);
  for_queries(e, inputs, [&](const Head& head, std::int64_t i) {
    const std::vector<double> p = softmax_of(scores(e, head, i, scale_, itself));
    for (std::int64_t c = 0; c < e.value_depth; ++c) {
      double sum = 0;
      for (std::int64_t j = 0; j < e.keys; ++j)
        sum += p[static_cast<std::size_t>(j)] * head.value[c * e.keys + j];
      y[head.output + c * e.queries + i] = sum;
    }
  });
}

void AttentionOp::error_scale(std::span<const Tensor> inputs, const Tensor& /*output*/, Tensor& scale) const {
  error_scale_of(inputs, k256Roundings, scale);
}

/// softmax_error_weights() of a_j = |scale|·sum |q·k_j|, times |v_j|.
void AttentionOp::error_scale_of(std::span<const Tensor> inputs, double most, Tensor& scale) const {
  const AttentionExtents e = extents({{inputs[0].shape(), inputs[1].shape(), inputs[2].shape()}});
  double* out = f64(scale);
  for_queries(e, inputs, [&](const Head& head, std::int64_t i) {
    const std::vector<double> weight = softmax_error_weights(
        scores(e, head, i, scale_, itself), scores(e, head, i, std::fabs(scale_), magnitude), most);
    for (std::int64_t c = 0; c < e.value_depth; ++c) {
      double sum = 0;
      for (std::int64_t j = 0; j < e.keys; ++j)
        sum += weight[static_cast<std::size_t>(j)] * std::fabs(head.value[c * e.keys + j]);
      out[head.output + c * e.queries + i] = sum;
    }
  });
}

double AttentionOp::macs(std::span<const Shape> inputs, const Shape& /*output*/) const {
  const AttentionExtents e = extents(inputs);
  return static_cast<double>(e.batch * e.heads * (e.depth + e.value_depth)) * static_cast<double>(e.queries) *
         static_cast<double>(e.keys);
}

Value attention(Value query, Value key, Value value, std::int64_t heads, double scale) {
  return query.graph().add(std::make_shared<AttentionOp>(heads, scale), {query, key, value});
}

}  // namespace slide::ops
