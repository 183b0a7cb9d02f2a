#include "ops/case_attributes.h"

#include <cmath>

#include "runtime/error.h"

namespace slide::ops {
namespace {

constexpr std::size_t kLongestText = 1 << 16;

/// A name from outside, short enough for a message.
std::string shown(std::string_view name) {
  constexpr std::size_t kShown = 40;
  return "\"" + std::string(name.substr(0, kShown)) + (name.size() > kShown ? "...\"" : "\"");
}

}  // namespace

CaseArguments::CaseArguments(std::string_view op, const std::string& attributes_json,
                             const std::vector<std::pair<std::string, Value>>& inputs)
    : op_(op), inputs_(inputs) {
  if (attributes_json.size() > kLongestText) fail("has attributes of more than 64 KiB");
  attributes_ = nlohmann::json::parse(attributes_json, nullptr, false);
  if (!attributes_.is_object()) fail("has attributes that are not a JSON object");
}

void CaseArguments::fail(const std::string& problem) const {
  throw Error(ErrorKind::kBadInput, "the case of operator " + op_ + " " + problem);
}

std::optional<Value> CaseArguments::optional_input(std::string_view name) {
  known_inputs_.emplace(name);
  for (const auto& [input_name, value] : inputs_)
    if (input_name == name) return value;
  return std::nullopt;
}

Value CaseArguments::input(std::string_view name) {
  const std::optional<Value> value = optional_input(name);
  if (!value) fail("has no input " + shown(name));
  return *value;
}

std::vector<Value> CaseArguments::numbered_inputs() {
  std::vector<Value> values{input("x0")};
  while (const std::optional<Value> next = optional_input("x" + std::to_string(values.size())))
    values.push_back(*next);
  return values;
}

const nlohmann::json* CaseArguments::find(std::string_view name, bool may_be_absent) {
  known_attributes_.emplace(name);
  const auto found = attributes_.find(name);
  if (found != attributes_.end()) return &*found;
  if (!may_be_absent) fail("has no attribute " + shown(name));
  return nullptr;
}

void CaseArguments::require_list(std::string_view name, const nlohmann::json& value, std::size_t least,
                                 std::size_t most) const {
  if (value.is_array() && value.size() >= least && value.size() <= most) return;
  fail("needs a list of " +
       (least == most ? std::to_string(least) : std::to_string(least) + " to " + std::to_string(most)) +
       " numbers as attribute " + shown(name));
}

std::int64_t CaseArguments::to_integer(std::string_view name, const nlohmann::json& value, std::int64_t least,
                                       std::int64_t most) const {
  // get<int64_t>() of an unsigned number beyond the signed range would wrap around.
  const bool fits =
      value.is_number_unsigned() ? value.get<std::uint64_t>() <= INT64_MAX : value.is_number_integer();
  if (fits) {
    const auto number = value.get<std::int64_t>();
    if (number >= least && number <= most) return number;
  }
  fail("needs whole numbers from " + std::to_string(least) + " to " + std::to_string(most) +
       " as attribute " + shown(name));
}

double CaseArguments::to_number(std::string_view name, const nlohmann::json& value) const {
  if (!value.is_number() || !std::isfinite(value.get<double>()))
    fail("needs finite numbers as attribute " + shown(name));
  return value.get<double>();
}

std::int64_t CaseArguments::integer(std::string_view name, std::int64_t least, std::int64_t most,
                                    std::optional<std::int64_t> otherwise) {
  const nlohmann::json* value = find(name, otherwise.has_value());
  return value != nullptr ? to_integer(name, *value, least, most) : otherwise.value_or(0);
}

double CaseArguments::number(std::string_view name, std::optional<double> otherwise) {
  const nlohmann::json* value = find(name, otherwise.has_value());
  return value != nullptr ? to_number(name, *value) : otherwise.value_or(0);
}

bool CaseArguments::boolean(std::string_view name, bool otherwise) {
  const nlohmann::json* value = find(name, true);
  if (value == nullptr) return otherwise;
  if (!value->is_boolean()) fail("needs true or false as attribute " + shown(name));
  return value->get<bool>();
}

std::size_t CaseArguments::choice(std::string_view name, std::initializer_list<std::string_view> choices,
                                  std::optional<std::size_t> otherwise) {
  const nlohmann::json* value = find(name, otherwise.has_value());
  if (value == nullptr) return otherwise.value_or(0);
  std::string list;
  std::size_t i = 0;
  for (const std::string_view c : choices) {
    if (value->is_string() && value->get_ref<const std::string&>() == c) return i;
    list += (i++ > 0 ? ", " : "") + std::string(c);
  }
  fail("needs one of " + list + " as attribute " + shown(name));
}

std::vector<std::int64_t> CaseArguments::integer_list(std::string_view name, std::int64_t least,
                                                      std::int64_t most, std::size_t most_values) {
  const nlohmann::json& list = *find(name, false);
  require_list(name, list, 1, most_values);
  std::vector<std::int64_t> result;
  for (const nlohmann::json& value : list) result.push_back(to_integer(name, value, least, most));
  return result;
}

std::optional<std::array<double, 2>> CaseArguments::optional_pair(std::string_view name) {
  const nlohmann::json* list = find(name, true);
  if (list == nullptr) return std::nullopt;
  require_list(name, *list, 2, 2);
  return std::array<double, 2>{to_number(name, (*list)[0]), to_number(name, (*list)[1])};
}

void CaseArguments::done() const {
  for (const auto& [name, value] : inputs_)
    if (!known_inputs_.contains(name))
      fail("has an input " + shown(name) + ", which the operator does not take");
  for (const auto& [name, value] : attributes_.items())
    if (!known_attributes_.contains(name))
      fail("has an attribute " + shown(name) + ", which the operator does not know");
}

}  // namespace slide::ops
