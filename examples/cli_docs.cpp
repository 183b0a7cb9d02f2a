#include "examples/cli_docs.h"

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <sstream>
#include <string_view>
#include <utility>
#include <vector>

#include "runtime/cpu.h"
#include "runtime/version.h"

namespace slide {
namespace {

using Options = std::vector<const CLI::Option*>;

/// Its own, and those of its option groups, which are subcommands without a name.
Options options_of(const CLI::App& app, bool positional) {
  Options options = app.get_options([positional](const CLI::Option* option) {
    return !option->get_group().empty() && option->get_positional() == positional;
  });
  for (const CLI::App* group : app.get_subcommands([](const CLI::App* a) { return a->get_name().empty(); }))
    for (const CLI::Option* option : options_of(*group, positional))
      if (std::ranges::find(options, option) == options.end()) options.push_back(option);
  return options;
}

std::vector<const CLI::App*> subcommands_of(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App* a) { return !a->get_name().empty(); });
}

bool takes_value(const CLI::Option& option) { return option.get_items_expected_max() > 0; }

/// "-o" and "--output".
std::vector<std::string> flags_of(const CLI::Option& option) {
  std::vector<std::string> flags;
  for (const std::string& name : option.get_snames()) flags.push_back("-" + name);
  for (const std::string& name : option.get_lnames()) flags.push_back("--" + name);
  return flags;
}

std::string upper(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return text;
}

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  std::istringstream stream(text);
  for (std::string part; std::getline(stream, part, separator);) parts.push_back(part);
  return parts;
}

/// A line of text for roff: characters that it would read as commands or typeset as others are named
/// (groff_char(7)).
std::string roff(const std::string& line) {
  std::string result;
  if (line.starts_with('.') || line.starts_with('\'')) result = "\\&";
  for (const char c : line) {
    switch (c) {
      case '\\':
        result += "\\e";
        break;
      case '-':
        result += "\\-";
        break;
      case '^':
        result += "\\(ha";
        break;
      case '~':
        result += "\\(ti";
        break;
      case '\'':
        result += "\\(aq";
        break;
      case '`':
        result += "\\(ga";
        break;
      default:
        result += c;
    }
  }
  return result;
}

/// An argument of a macro.
std::string quoted_roff(const std::string& text) {
  std::string result = "\"";
  for (const char c : roff(text)) result += c == '"' ? std::string("\\(dq") : std::string(1, c);
  return result + "\"";
}

/// "TEXT:{sbs,anaglyph}" and "INT:INT in [1 - 9]" are shown without the type that the check says again.
std::string shown_type(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  const std::size_t colon = type.find(':');
  return colon == std::string::npos ? type : type.substr(colon + 1);
}

void write_option(std::ostream& out, const CLI::Option& option) {
  out << ".TP\n";
  std::string separator;
  if (option.get_positional() && option.get_lnames().empty()) {
    out << "\\fI" << roff(option.get_name(true)) << "\\fR";
  } else {
    for (const std::string& flag : flags_of(option)) {
      out << separator << "\\fB" << roff(flag) << "\\fR";
      separator = ", ";
    }
    if (takes_value(option)) out << " \\fI" << roff(shown_type(option)) << "\\fR";
  }
  const bool has_default = takes_value(option) && !option.get_default_str().empty();
  out << '\n' << roff(option.get_description()) << (has_default ? ".\n" : "\n");
  if (has_default) out << "Default: " << roff(option.get_default_str()) << '\n';
}

void write_footer(std::ostream& out, const std::string& footer) {
  bool verbatim = false;
  const auto end_verbatim = [&] {
    if (std::exchange(verbatim, false)) out << ".fi\n";
  };
  for (const std::string& line : split(footer, '\n')) {
    const std::size_t colon = line.find(':');
    if (line.empty()) {
      end_verbatim();
    } else if (line.starts_with(' ')) {
      out << roff(line.substr(line.find_first_not_of(' '))) << '\n';
    } else if (colon != std::string::npos) {
      end_verbatim();
      out << ".SH " << quoted_roff(upper(line.substr(0, colon))) << '\n';
      verbatim = colon + 1 == line.size();
      if (verbatim)
        out << ".nf\n";
      else
        out << roff(line.substr(line.find_first_not_of(' ', colon + 1))) << '\n';
    } else {
      out << roff(line) << '\n';
    }
  }
  end_verbatim();
}

/// What an option's value can be.
struct Values {
  std::vector<std::string> words;
  bool files = false;
  bool folders = false;
};

Values values_of(const CLI::Option& option) {
  Values values;
  const std::string type = option.get_type_name();
  if (const std::size_t open = type.find('{'); open != std::string::npos) {
    values.words = split(type.substr(open + 1, type.find('}') - open - 1), ',');
    return values;
  }
  for (const std::string& part : split(type, '|')) {
    values.files = values.files || part.starts_with("FILE");
    values.folders = values.folders || part.starts_with("DIR");
    if (!part.empty() && std::islower(static_cast<unsigned char>(part[0])) != 0) values.words.push_back(part);
  }
  return values;
}

std::string joined(const std::vector<std::string>& parts, std::string_view separator) {
  std::string result;
  for (const std::string& part : parts) {
    if (!result.empty()) result += separator;
    result += part;
  }
  return result;
}

/// One branch of the script's `case`: what follows this option. Nothing is offered for numbers and names.
void write_values(std::ostream& out, const CLI::Option& option) {
  const Values values = values_of(option);
  std::string actions;
  if (!values.words.empty()) actions += " -W '" + joined(values.words, " ") + "'";
  if (values.files) actions += " -f";
  if (values.folders) actions += " -d";
  out << "    " << joined(flags_of(option), "|") << ")\n";
  if (!actions.empty())
    out << "      compopt -o filenames 2>/dev/null\n      mapfile -t COMPREPLY < <(compgen" << actions
        << " -- \"$cur\")\n";
  out << "      return ;;\n";
}

/// " FILE ...": what a command takes beside options.
void write_positionals(std::ostream& out, const CLI::App& command) {
  for (const CLI::Option* option : options_of(command, true)) {
    out << " \\fI" << roff(option->get_name(true)) << "\\fR";
    if (option->get_items_expected_max() > 1) out << " ...";
  }
}

void write_options_by_group(std::ostream& out, const CLI::App& app) {
  const Options options = options_of(app, false);
  for (const std::string& group : app.get_groups()) {
    const auto in_group = [&](const CLI::Option* option) { return option->get_group() == group; };
    if (std::none_of(options.begin(), options.end(), in_group)) continue;
    out << ".SS " << quoted_roff(group) << '\n';
    for (const CLI::Option* option : options)
      if (in_group(option)) write_option(out, *option);
  }
}

void write_subcommand(std::ostream& out, const CLI::App& command) {
  out << ".SS " << quoted_roff(command.get_name()) << "\n\\fB" << roff(command.get_name()) << "\\fR";
  write_positionals(out, command);
  out << " [\\fIoption\\fR ...]\n.PP\n" << roff(command.get_description()) << '\n';
  for (const CLI::Option* option : options_of(command, true)) write_option(out, *option);
  for (const CLI::Option* option : options_of(command, false)) write_option(out, *option);
}

/// A function that completes the options of one command, and files beside them.
void write_completion(std::ostream& out, const CLI::App& command, const std::string& function) {
  const Options options = options_of(command, false);
  std::vector<std::string> flags;
  for (const CLI::Option* option : options)
    for (const std::string& flag : flags_of(*option)) flags.push_back(flag);
  // Bash splits --option=value into three words.
  out << function << "() {\n"
      << "  local cur=${COMP_WORDS[COMP_CWORD]} prev=${COMP_WORDS[COMP_CWORD-1]}\n"
      << "  COMPREPLY=()\n"
      << "  [[ $prev == = ]] && prev=${COMP_WORDS[COMP_CWORD-2]}\n"
      << "  [[ $cur == = ]] && cur=\n"
      << "  case $prev in\n";
  for (const CLI::Option* option : options)
    if (takes_value(*option)) write_values(out, *option);
  out << "  esac\n"
      << "  if [[ $cur == -* ]]; then\n"
      << "    mapfile -t COMPREPLY < <(compgen -W '" << joined(flags, " ") << "' -- \"$cur\")\n"
      << "  else\n"
      << "    compopt -o filenames 2>/dev/null\n"
      << "    mapfile -t COMPREPLY < <(compgen -f -- \"$cur\")\n"
      << "  fi\n"
      << "}\n";
}

/// The function of a program with subcommands: their names as the first word, then what they complete.
void write_choice(std::ostream& out, const CLI::App& app, const std::string& name) {
  std::vector<std::string> words;
  for (const CLI::App* command : subcommands_of(app)) words.push_back(command->get_name());
  for (const CLI::Option* option : options_of(app, false))
    for (const std::string& flag : flags_of(*option)) words.push_back(flag);
  out << '_' << name << "() {\n"
      << "  if ((COMP_CWORD == 1)); then\n"
      << "    mapfile -t COMPREPLY < <(compgen -W '" << joined(words, " ") << "' -- \"${COMP_WORDS[1]}\")\n"
      << "    return\n"
      << "  fi\n"
      << "  case ${COMP_WORDS[1]} in\n";
  for (const CLI::App* command : subcommands_of(app))
    out << "    " << command->get_name() << ") _" << name << '_' << command->get_name() << " ;;\n";
  out << "    *) COMPREPLY=() ;;\n"
      << "  esac\n"
      << "}\n";
}

std::string version_text(const std::string& name) {
  return name + " " + std::string(version()) + "\nbuild: " + std::string(build_description()) +
         "\ninstruction set: " + std::string(name_of(detected_isa())) +
         "\nfeatures: " + text_of(detected_features());
}

}  // namespace

std::string man_page(const CLI::App& app, const std::string& name, const std::string& version) {
  std::ostringstream out;
  out << ".TH " << quoted_roff(upper(name)) << " 1 \"\" " << quoted_roff(version) << " \"User Commands\"\n";
  std::string summary = app.get_description();
  if (summary.ends_with('.')) summary.pop_back();
  if (!summary.empty()) summary[0] = static_cast<char>(std::tolower(static_cast<unsigned char>(summary[0])));
  out << ".SH NAME\n"
      << roff(name) << " \\- " << roff(summary) << "\n.SH SYNOPSIS\n\\fB" << roff(name) << "\\fR";
  const std::vector<const CLI::App*> commands = subcommands_of(app);
  if (!commands.empty()) out << " \\fIcommand\\fR ...";
  write_positionals(out, app);
  out << " [\\fIoption\\fR ...]\n";
  if (const Options positionals = options_of(app, true); !positionals.empty()) {
    out << ".SH ARGUMENTS\n";
    for (const CLI::Option* option : positionals) write_option(out, *option);
  }
  if (!commands.empty()) out << ".SH COMMANDS\n";
  for (const CLI::App* command : commands) write_subcommand(out, *command);
  out << ".SH OPTIONS\n";
  write_options_by_group(out, app);
  write_footer(out, app.get_footer());
  return out.str();
}

std::string bash_completion(const CLI::App& app, const std::string& name) {
  std::ostringstream out;
  out << "# Completion of " << name << " for bash.\n";
  const std::vector<const CLI::App*> commands = subcommands_of(app);
  for (const CLI::App* command : commands)
    write_completion(out, *command, "_" + name + "_" + command->get_name());
  if (commands.empty())
    write_completion(out, app, "_" + name);
  else
    write_choice(out, app, name);
  out << "complete -F _" << name << ' ' << name << '\n';
  return out.str();
}

void add_help_options(CLI::App& app, const std::string& name) {
  const std::string group = app.get_help_ptr()->get_group();
  const auto printing = [&app, group](const std::string& flag, const std::string& what, const auto& text) {
    app.add_flag_callback(
           flag,
           [text] {
             std::fputs(text().c_str(), stdout);
             throw CLI::Success();
           },
           what)
        ->group(group);
  };
  printing("--version", "Print the version, how this program was built, and this CPU's level",
           [name] { return version_text(name) + "\n"; });
  printing("--man", "Print this as a manual page: " + name + " --man | man -l -",
           [&app, name] { return man_page(app, name, "SLIDE " + std::string(version())); });
  printing("--completion", "Print the completion script for bash: source <(" + name + " --completion)",
           [&app, name] { return bash_completion(app, name); });
}

}  // namespace slide
