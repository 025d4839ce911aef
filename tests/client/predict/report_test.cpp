#include "client/predict/report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <regex>
#include <set>
#include <string>
#include <vector>

#include "client/predict/answer_warnings.h"
#include "client/predict/exported.h"
#include "tests/client/predict/decoded_png.h"

namespace itn {
namespace {

using ::testing::AllOf;
using testing::decoded_png;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

v1::ParameterPosterior posterior(double low, double high) {
  v1::ParameterPosterior result;
  result.set_low(low);
  result.set_high(high);
  return result;
}

v1::Prediction prediction(const std::vector<std::string>& channels) {
  v1::Prediction result;
  result.set_image("photos/wax.png");
  result.set_model("small 1.2, step 3");
  result.mutable_model_version()->set_name("small");
  result.mutable_model_version()->set_sha256("0123abcd");
  for (const std::string& name : channels) {
    v1::Prediction::Channel& channel = *result.add_channels();
    channel.set_channel(name);
    channel.set_sigma_t(50);
    channel.set_albedo(0.5);
    channel.set_g(-0.125);
    *channel.mutable_posterior()->mutable_sigma_t() = posterior(10, 100);
    *channel.mutable_posterior()->mutable_albedo() = posterior(0.25, 0.75);
    *channel.mutable_posterior()->mutable_g() = posterior(-0.5, 0);
    channel.mutable_caveats()->mutable_outlier()->set_score(0.5);
  }
  return result;
}

Panel panel(int side, Rgb colour) {
  return {.side = side, .pixels = std::vector<Rgb>(static_cast<size_t>(side * side), colour)};
}

Report report_of(const v1::Prediction& answer) {
  Report report;
  report.prediction = answer;
  report.photographs = {{answer, PanelRow(3, panel(5, {1, 2, 3}))}};
  report.swatches = {{"Cube", "sun and sky", panel(7, {200, 100, 0})}};
  return report;
}

std::vector<std::string> matches(const std::string& text, const std::string& pattern) {
  const std::regex regex(pattern);
  std::vector<std::string> found;
  for (std::sregex_iterator at(text.begin(), text.end(), regex), end; at != end; ++at) {
    found.push_back((*at)[1]);
  }
  return found;
}

// Without its style and script, which have a language of their own.
std::string markup_of(const std::string& page) {
  return std::regex_replace(page, std::regex("<(style|script)>[^]*?</(style|script)>"), "");
}

// What is wrong with the nesting of the tags; empty if nothing is.
std::string nesting_errors(const std::string& page) {
  const std::set<std::string> empty_elements{"meta", "img", "!doctype"};
  std::vector<std::string> open;
  const std::string markup = markup_of(page);
  const std::regex tag(R"(<(/?)([!a-z0-9]+)((?: [a-zA-Z-]+(?:="[^"<>]*")?)*(?: html)?)>|[<>])");
  for (std::sregex_iterator at(markup.begin(), markup.end(), tag), end; at != end; ++at) {
    const std::string name = (*at)[2];
    if (name.empty()) return "a lone < or > before " + at->suffix().str().substr(0, 40);
    if (empty_elements.contains(name)) continue;
    if ((*at)[1].length() == 0) {
      open.push_back(name);
    } else if (open.empty() || open.back() != name) {
      return "</" + name + "> does not close " + (open.empty() ? "anything" : open.back());
    } else {
      open.pop_back();
    }
  }
  return open.empty() ? "" : open.back() + " is left open";
}

std::string from_base64(const std::string& text) {
  const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string bytes;
  uint32_t bits = 0;
  int count = 0;
  for (const char c : text.substr(0, text.find('='))) {
    bits = bits << 6 | static_cast<uint32_t>(digits.find(c));
    if ((count += 6) >= 8) bytes.push_back(static_cast<char>(bits >> (count -= 8)));
  }
  return bytes;
}

TEST(NestingErrors, AreFound) {
  EXPECT_EQ(nesting_errors("<!doctype html><p class=\"a\">x<img src=\"y\"></p>"), "");
  for (const char* wrong : {"<p>", "<p><b></p></b>", "</p>", "a < b", "<p class=\"a<b\"></p>"}) {
    EXPECT_NE(nesting_errors(wrong), "") << wrong;
  }
}

TEST(Report, IsWellFormedAndLoadsNothing) {
  for (const auto& channels : {std::vector<std::string>{"Y"}, {"R", "G", "B"}}) {
    Report report = report_of(prediction(channels));
    report.range.emplace();
    const std::string page = report_page(report);
    EXPECT_EQ(nesting_errors(page), "");
    EXPECT_THAT(page, AllOf(HasSubstr("<!doctype html>"), HasSubstr("default-src 'none'"),
                            Not(HasSubstr("http://")), Not(HasSubstr("@import")),
                            Not(HasSubstr("url(")), Not(HasSubstr(" href="))));
    for (const std::string& source : matches(page, " src=\"([^\"]{0,40})")) {
      EXPECT_THAT(source, ::testing::StartsWith("data:image/png;base64,"));
    }
  }
}

TEST(Report, HasImagesThatDecode) {
  const std::string page = report_page(report_of(prediction({"Y"})));
  const std::vector<std::string> images = matches(page, "base64,([A-Za-z0-9+/=]+)\"");
  ASSERT_EQ(images.size(), 4);
  EXPECT_EQ(decoded_png(from_base64(images[0])).at(4, 4), (Rgb{1, 2, 3}));
  const auto swatch = decoded_png(from_base64(images[3]));
  EXPECT_EQ(swatch.width, 7);
  EXPECT_EQ(swatch.height, 7);
  EXPECT_EQ(swatch.at(6, 6), (Rgb{200, 100, 0}));
}

TEST(Report, EscapesWhatStrangersWrote) {
  const std::string hostile = "<script>alert(\"1\")</script>&'\x1b[31m";
  v1::Prediction answer = prediction({"Y"});
  answer.set_image(hostile);
  answer.set_model(hostile);
  answer.mutable_model_version()->set_name(hostile);
  answer.mutable_model_version()->set_version(hostile);
  answer.mutable_model_version()->set_sha256(hostile);
  v1::Prediction::Channel& channel = *answer.mutable_channels(0);
  channel.set_channel(hostile);
  channel.mutable_caveats()->add_warnings()->set_text(hostile);
  channel.mutable_caveats()->mutable_outlier()->set_is_outlier(true);
  channel.mutable_caveats()->mutable_outlier()->set_reason(hostile);
  Report report = report_of(answer);
  report.photographs.push_back(report.photographs.front());
  report.prediction.set_combined(true);
  const std::string page = report_page(report);
  EXPECT_EQ(nesting_errors(page), "");
  EXPECT_THAT(page,
              AllOf(Not(HasSubstr("<script>alert")), Not(HasSubstr("\x1b")),
                    HasSubstr("&lt;script&gt;alert(&quot;1&quot;)"), HasSubstr("&amp;&#39;")));
}

// --- Trust ---

TEST(Report, SaysFirstWhatLimitsTheAnswer) {
  v1::Prediction answer = prediction({"R", "G", "B"});
  for (v1::Prediction::Channel& channel : *answer.mutable_channels()) {
    v1::Warning& size = *channel.mutable_caveats()->add_warnings();
    size.set_kind(v1::Warning::SIZE_UNKNOWN);
    size.set_text("size unknown: a");
  }
  v1::AnswerWarnings& second = *answer.mutable_channels(1)->mutable_caveats();
  v1::Warning& black = *second.add_warnings();
  black.set_kind(v1::Warning::BLACK);
  black.set_text("it is dark");
  second.add_at_bounds(v1::SIGMA_T_MAX);
  second.add_at_bounds(v1::G_MIN);
  second.mutable_outlier()->set_is_outlier(true);
  second.mutable_outlier()->set_score(3);
  second.mutable_outlier()->set_reason("mean radiance");
  const std::vector<Limit> limits = limits_of(answer);
  ASSERT_EQ(limits.size(), 4);
  EXPECT_TRUE(limits[0].is_grave);
  EXPECT_THAT(limits[0].text, AllOf(HasSubstr("G: The photograph is an outlier"),
                                    HasSubstr("3.0 times"), HasSubstr("mean radiance.")));
  EXPECT_EQ(limits[1].text, "Size unknown: a.") << "what holds for all channels, once";
  EXPECT_EQ(limits[2].text, "G: It is dark.");
  EXPECT_THAT(limits[3].text, AllOf(HasSubstr("G: The 90 % interval reaches the greatest sigma_t"),
                                    HasSubstr("and the least g")));
  const std::string page = report_page(report_of(answer));
  EXPECT_THAT(page, HasSubstr("Do not trust this answer"));
  for (const Limit& limit : limits) EXPECT_THAT(page, HasSubstr(limit.text));
  EXPECT_LT(page.find("Do not trust this answer"), page.find("<table>"));
}

TEST(Report, SaysThatNothingIsKnownToLimitIt) {
  EXPECT_THAT(limits_of(prediction({"Y"})), IsEmpty());
  EXPECT_THAT(report_page(report_of(prediction({"Y"}))), HasSubstr("Nothing known to limit it"));
  v1::Prediction blind = prediction({"Y"});
  blind.mutable_channels(0)->mutable_caveats()->clear_outlier();
  ASSERT_EQ(limits_of(blind).size(), 1);
  EXPECT_FALSE(limits_of(blind)[0].is_grave);
  EXPECT_THAT(limits_of(blind)[0].text, HasSubstr("does not know the images of its training"));
}

TEST(Report, ListsThePhotographsOfOneMaterialWithTheirOwnLimits) {
  v1::Prediction other = prediction({"Y"});
  other.set_image("photos/other.png");
  other.mutable_channels(0)->mutable_caveats()->add_warnings()->set_text("cut off");
  Report report = report_of(prediction({"Y"}));
  report.photographs.push_back({other, PanelRow(3, panel(4, {0, 0, 0}))});
  report.prediction.set_combined(true);
  const std::string page = report_page(report);
  EXPECT_EQ(nesting_errors(page), "");
  EXPECT_THAT(page, AllOf(HasSubstr("from 2 photographs"), HasSubstr(">wax.png<"),
                          HasSubstr(">other.png<"), HasSubstr("<li>Cut off.</li>")));
  EXPECT_THAT(page, HasSubstr("Nothing known to limit it")) << "of this answer";
}

// --- Numbers ---

TEST(Report, HasTheNumbersAndTheirIntervals) {
  v1::Prediction answer = prediction({"Y"});
  EXPECT_THAT(report_page(report_of(answer)),
              AllOf(HasSubstr("<td class=\"best\">50</td><td>10 to 100</td>"),
                    HasSubstr("<td class=\"best\">0.500</td><td>0.250 to 0.750</td>"),
                    HasSubstr("<td class=\"best\">\u22120.125</td><td>\u22120.500 to 0.000</td>"),
                    HasSubstr("size is not known"), HasSubstr("1/length"), HasSubstr("0123abcd"),
                    Not(HasSubstr("<svg"))));
  answer.set_object_size(40);
  EXPECT_THAT(report_page(report_of(answer)),
              AllOf(HasSubstr("40 mm"), HasSubstr("1/mm"), Not(HasSubstr("1/length"))));
  answer.mutable_channels(0)->clear_posterior();
  EXPECT_THAT(report_page(report_of(answer)), HasSubstr("<td>&ndash;</td>"));
}

v1::Interval interval(double min, double max) {
  v1::Interval result;
  result.set_min(min);
  result.set_max(max);
  return result;
}

TEST(Report, DrawsIntervalsWithinTheRangeOfTheModel) {
  v1::Prediction answer = prediction({"Y"});
  answer.set_object_size(10);
  Report report = report_of(answer);
  report.range.emplace();
  *report.range->mutable_sigma_t() = interval(10, 1e5);  // of an object of 10 mm: 1 to 10^4
  *report.range->mutable_albedo() = interval(0, 1);
  *report.range->mutable_g() = interval(-0.25, 0.75);
  const std::string page = report_page(report);
  EXPECT_EQ(matches(page, R"(class="span" x="([0-9.]+)\")"),
            (std::vector<std::string>{"25.00", "25.00", "0.00"}));
  EXPECT_EQ(matches(page, R"(class="span" x="[0-9.]+" y="3" width="([0-9.]+)\")"),
            (std::vector<std::string>{"25.00", "50.00", "25.00"}));
  EXPECT_EQ(matches(page, R"(class="mark" x="([0-9.]+)\")").at(1), "49.40");  // 1.2 wide
  EXPECT_THAT(page, HasSubstr("1 to 1e+04"));
}

TEST(Report, HasTheMaterialsOfAllRenderers) {
  const std::string page = report_page(report_of(prediction({"R", "G", "B"})));
  for (const ExportFormat& format : export_formats()) {
    EXPECT_THAT(page, HasSubstr("<b>" + std::string(format.name) + "</b>"));
  }
  EXPECT_EQ(matches(page, "(<pre>[^<])").size(), export_formats().size());
  EXPECT_THAT(page, HasSubstr("&lt;medium"));
}

TEST(Exported, HasIntervalsAndWhatLimitsTheAnswerInItsComment) {
  v1::Prediction answer = prediction({"Y"});
  answer.mutable_channels(0)->mutable_caveats()->add_warnings()->set_text("too dark");
  EXPECT_THAT(
      exported(answer, export_format("pbrt"), {}),
      ::testing::AllOf(HasSubstr("# Y: 90 % intervals: sigma_t 10 to 100 1/mm, albedo 0.250 to "
                                 "0.750, g -0.500 to 0.000\n"),
                       HasSubstr("# Too dark.\n")));
}

}  // namespace
}  // namespace itn
