#include "ops/normalise/normalise.h"

#include <cmath>
#include <limits>

#include "judge.h"
#include "ops/normalise/normalise_ops.h"

using namespace slide;
using test::Call;
using test::call_of;
using test::random_tensor;
using test::tensor_by;
using test::tensor_of;
using test::values;

namespace {

Call group_norm(Tensor x, std::int64_t groups, unsigned seed) {
  const std::int64_t channels = x.shape()[1];
  return {{std::move(x), random_tensor({channels}, seed), random_tensor({channels}, seed + 1)},
          [&](const std::vector<Value>& v) { return ops::group_norm(v[0], groups, v[1], v[2], 1e-5); }};
}

/// x · factor + shift
Tensor moved(const Tensor& x, double factor, double shift) {
  return tensor_by(x.shape(), [&](std::int64_t i) {
    return static_cast<double>(
        static_cast<float>(x.data<double>()[static_cast<std::size_t>(i)] * factor + shift));
  });
}

}  // namespace

TEST_CASE("batch norm with its own statistics is the identity, and keeps its bound for any rank") {
  for (const Shape& shape : {Shape{3, 4}, Shape{2, 4, 7}, Shape{2, 4, 5, 17}, Shape{1, 4, 3, 2, 5}}) {
    const Tensor ones = tensor_by({4}, [](std::int64_t) { return 1.0; });
    const Tensor zeros = tensor_by({4}, [](std::int64_t) { return 0.0; });
    const auto build = [](const std::vector<Value>& v) {
      return ops::batch_norm(v[0], v[1], v[2], v[3], v[4], 0);
    };
    const Call identity({random_tensor(shape, 1), ones, zeros, zeros, ones}, build);
    CHECK(max_abs_difference(identity.reference(), identity.inputs[0]) == 0);
    const Tensor variance = tensor_by({4}, [](std::int64_t i) { return 0.1 + static_cast<double>(i); });
    test::judge({{random_tensor(shape, 2, 10), random_tensor({4}, 3), random_tensor({4}, 4),
                  random_tensor({4}, 5, 100), variance},
                 build});
  }
}

TEST_CASE("group norm gives each group mean 0 and variance 1 whatever it was given") {
  for (const std::int64_t groups : {1, 2, 6}) {
    const Tensor x = moved(random_tensor({2, 6, 9, 11}, 1), 5, 20);
    const Tensor ones = tensor_by({6}, [](std::int64_t) { return 1.0; });
    const Tensor zeros = tensor_by({6}, [](std::int64_t) { return 0.0; });
    const Call call({x, ones, zeros}, [&](const std::vector<Value>& v) {
      return ops::group_norm(v[0], groups, v[1], v[2], 0);
    });
    const std::vector<double> y = values(call.reference());
    const std::size_t count = y.size() / static_cast<std::size_t>(2 * groups);
    for (std::size_t g = 0; g < y.size(); g += count) {
      double sum = 0;
      double squares = 0;
      for (std::size_t i = g; i < g + count; ++i) {
        sum += y[i];
        squares += y[i] * y[i];
      }
      CHECK(std::fabs(sum) / static_cast<double>(count) < 1e-13);
      CHECK(std::fabs(squares / static_cast<double>(count) - 1) < 1e-13);
    }
  }
}

TEST_CASE("group norm kernels keep their bound, also where the mean is far larger than the deviation") {
  for (const std::int64_t width : {1, 3, 16, 21}) {
    for (const std::int64_t groups : {1, 2, 4})
      test::judge(group_norm(random_tensor({2, 4, 5, width}, 1), groups, 2));
    test::judge(group_norm(moved(random_tensor({1, 4, 5, width}, 3), 1, 1000), 2, 4));
    test::judge(group_norm(moved(random_tensor({1, 4, 5, width}, 5), 0, 7), 2, 6));  // no deviation at all
  }
}

TEST_CASE(
    "group norm with a residual and an activation is their composition, and its kernels keep their bound") {
  const Shape shape{2, 4, 5, 700};  // planes of more than one piece
  for (const ops::UnaryKind kind :
       {ops::UnaryKind::kRelu, ops::UnaryKind::kLeakyRelu, ops::UnaryKind::kSigmoid})
    for (const bool residual : {false, true}) {
      const auto activation =
          std::make_shared<ops::UnaryOp>(kind, kind == ops::UnaryKind::kLeakyRelu ? 0.1 : 0);
      std::vector<Tensor> inputs{random_tensor(shape, 1), random_tensor({4}, 2), random_tensor({4}, 3)};
      if (residual) inputs.push_back(random_tensor(shape, 4));
      const Call call(inputs, [&](const std::vector<Value>& v) {
        return v[0].graph().add(
            std::make_shared<ops::GroupNormOp>(2, 1e-5, ops::GroupNormFusion{residual, activation}), v);
      });
      inputs.resize(3);
      const std::vector<double> plain = values(Call(inputs, [](const std::vector<Value>& v) {
                                                 return ops::group_norm(v[0], 2, v[1], v[2], 1e-5);
                                               }).reference());
      const std::vector<double> y = values(call.reference());
      const std::vector<double> added = residual ? values(call.inputs[3]) : std::vector<double>(y.size());
      for (std::size_t i = 0; i < y.size(); ++i) REQUIRE(y[i] == activation->evaluate(plain[i] + added[i]));
      test::judge(call);
    }
}

TEST_CASE("standardised weights have mean 0 and biased variance 1, filter by filter") {
  const Call call = call_of(moved(random_tensor({5, 3, 3, 3}, 1), 0.2, 0.3),
                            [](Value w) { return ops::weight_standardise(w, 0); });
  const std::vector<double> y = values(call.reference());
  for (std::size_t f = 0; f < 5; ++f) {
    double sum = 0;
    double squares = 0;
    for (std::size_t i = f * 27; i < (f + 1) * 27; ++i) {
      sum += y[i];
      squares += y[i] * y[i];
    }
    CHECK(std::fabs(sum) < 1e-12);
    CHECK(std::fabs(squares / 27 - 1) < 1e-12);
  }
  test::judge(call);
  test::judge(
      call_of(random_tensor({3, 19, 1, 1}, 2), [](Value w) { return ops::weight_standardise(w, 1e-5); }));
}

TEST_CASE("min-max normalisation maps the smallest to 0 and the largest to 1") {
  for (const std::int64_t n : {2, 5, 17, 70000}) {
    const Call call = call_of(random_tensor({n}, static_cast<unsigned>(n)),
                              [](Value x) { return ops::min_max_normalise(x); });
    const std::vector<double> y = values(call.reference());
    CHECK(*std::ranges::min_element(y) == 0);
    CHECK(*std::ranges::max_element(y) == 1);
    test::judge(call);
  }
}

TEST_CASE("a scene without relief becomes zeros, and NaN or an infinity is never normalised away") {
  constexpr double kInf = std::numeric_limits<double>::infinity();
  const auto normalised = [](const std::vector<double>& x) {
    const Call call = call_of(tensor_of({static_cast<std::int64_t>(x.size())}, x),
                              [](Value v) { return ops::min_max_normalise(v); });
    test::judge(call);
    return values(call.reference());
  };
  CHECK(normalised({0.5, 0.5, 0.5}) == std::vector<double>{0, 0, 0});
  CHECK(normalised({1000, 1000 + 0x1p-11, 1000}) ==
        std::vector<double>{0, 0, 0});                                 // 4.9e-4 of 1e3: below 1e-6
  CHECK(normalised({0, 0x1p-19, 0}) == std::vector<double>{0, 1, 0});  // 1.9e-6: relief
  CHECK(normalised({0, 0x1p-20, 0}) == std::vector<double>{0, 0, 0});  // 0.95e-6: none
  for (const double bad : {std::nan(""), kInf, -kInf})
    for (const double v : normalised({0, 1, bad, 2})) CHECK(std::isnan(v));
}

TEST_CASE("normalisation subtracts the mean first: means far larger than the deviation cost no bits") {
  // |error| <= 2^-20 where |y| is a few units: a scale of |x| + |mean| would allow 0.3.
  for (const double mean : {1e4, 1e6, 1e8}) {
    const Tensor x = moved(random_tensor({2, 4, 9, 65}, 1), mean * 0x1p-23 + 1, mean);
    const Call call = group_norm(x, 2, 2);
    for (const double s : values(call.error_scale(call.reference()))) REQUIRE(s < 24);
    test::judge(call);
    test::judge(call_of(x, [](Value v) { return ops::weight_standardise(v, 1e-5); }));
  }
}

TEST_CASE("normalisation holds at both ends of float32's range: of x, of the mean, of 1/deviation") {
  const auto channels = [](double v) { return tensor_by({4}, [v](std::int64_t) { return v; }); };
  const auto batch = [&](double size, double weight, double mean, double variance) {
    return Call(
        {random_tensor({1, 4, 5, 17}, 1, size), channels(static_cast<float>(weight)), channels(0.5),
         channels(static_cast<float>(mean)), channels(static_cast<float>(variance))},
        [](const std::vector<Value>& v) { return ops::batch_norm(v[0], v[1], v[2], v[3], v[4], 1e-5); });
  };
  for (const double size : {1e-30, 1e-3, 1e30, 4e37})
    for (const double weight : {1e-35, 1e-20, 1.0, 1e20})
      for (const double mean : {0.0, 5e30, 3e38})
        for (const double variance : {0.0, 1.0, 1e38}) test::judge(batch(size, weight, mean, variance));
  for (const double size : {1e-30, 1e-18, 1e18, 4e37}) {
    test::judge(group_norm(random_tensor({1, 4, 5, 17}, 1, size), 2, 4));
    test::judge(call_of(random_tensor({5, 3, 3, 3}, 1, size),
                        [](Value w) { return ops::weight_standardise(w, 1e-5); }));
  }
  // A definite number, not a bound: 3e38 · 1e-20 / sqrt(1e38) = 0.3.
  const Call call = batch(0, 1e-20, -3e38, 1e38);
  for (const double y : values(call.reference())) CHECK(std::fabs(y - 0.8) < 1e-6);
}

TEST_CASE("min-max normalisation holds where largest - smallest is beyond float32") {
  const Tensor x = tensor_by({70000}, [](std::int64_t i) {
    return static_cast<double>(static_cast<float>((static_cast<double>(i) - 35000) * 9e33));
  });
  const Call call = call_of(x, [](Value v) { return ops::min_max_normalise(v); });
  CHECK(values(call.reference())[35000] == doctest::Approx(0.5).epsilon(1e-4));
  test::judge(call);
}

TEST_CASE("parameters of a wrong shape are refused by name") {
  Graph g;
  const Value x = g.input("x", {1, 6, 5, 5});
  const Value six = g.input("six", {6});
  const Value five = g.input("five", {5});
  CHECK(test::refusal([&] {
          (void)ops::batch_norm(x, six, six, five, six, 1e-5);
        }).find("running mean has shape 5, 6") != std::string::npos);
  CHECK(test::refusal([&] { (void)ops::group_norm(x, 4, six, six, 1e-5); }).find("6 channels of 1x6x5x5") !=
        std::string::npos);
  CHECK(test::refusal([&] { (void)ops::group_norm(x, 0, six, six, 1e-5); }).find("groups is 0") !=
        std::string::npos);
  CHECK(test::refusal([&] { (void)ops::batch_norm(x, six, six, six, six, -1); }).find("eps is -1") !=
        std::string::npos);
  CHECK(test::refusal([&] { (void)ops::weight_standardise(six, 1e-5); }).find("rank 4") != std::string::npos);
}
