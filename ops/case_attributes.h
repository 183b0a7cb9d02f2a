#pragma once

#include <array>
#include <cstdint>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "runtime/graph.h"

namespace slide::ops {

/// Inputs and attributes of an operator case while its graph is built. Every question about a name marks it
/// as known; done() then refuses what nobody asked for. All functions throw Error(kBadInput) naming the
/// operator and the input or attribute.
class CaseArguments {
 public:
  CaseArguments(std::string_view op, const std::string& attributes_json,
                const std::vector<std::pair<std::string, Value>>& inputs);

  /// The value of an input; error if it is missing.
  [[nodiscard]] Value input(std::string_view name);
  [[nodiscard]] std::optional<Value> optional_input(std::string_view name);
  /// x0, x1, ... in this order, at least x0.
  [[nodiscard]] std::vector<Value> numbered_inputs();

  /// A whole number in [least, most]; the default where the attribute is absent, error if there is none.
  [[nodiscard]] std::int64_t integer(std::string_view name, std::int64_t least, std::int64_t most,
                                     std::optional<std::int64_t> otherwise = std::nullopt);
  /// A finite number.
  [[nodiscard]] double number(std::string_view name, std::optional<double> otherwise = std::nullopt);
  [[nodiscard]] bool boolean(std::string_view name, bool otherwise);
  /// The position of the attribute's text among the choices.
  [[nodiscard]] std::size_t choice(std::string_view name, std::initializer_list<std::string_view> choices,
                                   std::optional<std::size_t> otherwise = std::nullopt);
  /// N whole numbers in [least, most].
  template <std::size_t N>
  [[nodiscard]] std::array<std::int64_t, N> integers(
      std::string_view name, std::int64_t least, std::int64_t most,
      std::optional<std::array<std::int64_t, N>> otherwise = std::nullopt) {
    std::array<std::int64_t, N> result{};
    const nlohmann::json* list = find(name, otherwise.has_value());
    if (list == nullptr) return *otherwise;
    require_list(name, *list, N, N);
    for (std::size_t i = 0; i < N; ++i) result[i] = to_integer(name, (*list)[i], least, most);
    return result;
  }
  /// One to `most_values` whole numbers in [least, most].
  [[nodiscard]] std::vector<std::int64_t> integer_list(std::string_view name, std::int64_t least,
                                                       std::int64_t most, std::size_t most_values);
  /// Two finite numbers, or nothing if the attribute is absent.
  [[nodiscard]] std::optional<std::array<double, 2>> optional_pair(std::string_view name);

  /// Refuses inputs and attributes that nobody asked for.
  void done() const;

 private:
  [[noreturn]] void fail(const std::string& problem) const;
  [[nodiscard]] const nlohmann::json* find(std::string_view name, bool may_be_absent);
  void require_list(std::string_view name, const nlohmann::json& value, std::size_t least,
                    std::size_t most) const;
  [[nodiscard]] std::int64_t to_integer(std::string_view name, const nlohmann::json& value,
                                        std::int64_t least, std::int64_t most) const;
  [[nodiscard]] double to_number(std::string_view name, const nlohmann::json& value) const;

  std::string op_;
  nlohmann::json attributes_;
  const std::vector<std::pair<std::string, Value>>& inputs_;
  std::set<std::string, std::less<>> known_attributes_;
  std::set<std::string, std::less<>> known_inputs_;
};

}  // namespace slide::ops
