#include <glib.h>

extern "C" {
#include "ui.h"
}

#include <algorithm>
#include <cmath>

#include <imgui.h>

#define GLFW_INCLUDE_NONE
#include <backends/imgui_impl_glfw.h>
#include <backends/imgui_impl_opengl3.h>
#include <GLFW/glfw3.h>

namespace {

const char *const FONT = "/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf";
const float FONT_SIZE = 15.0F;

/* Latin and Greek letters, dashes, dots and quotation marks, and characters for formulas: sub- and
 * superscripts, arrows, operators. */
const ImWchar RANGES[] = {0x20,   0x24F,  0x370,  0x3FF,  0x2010, 0x2026, 0x2070,
                          0x209C, 0x2190, 0x2194, 0x2200, 0x2265, 0};

/* colours of the dots, by enum ui_dot_kind */
const ImU32 COLOURS[] = {IM_COL32(120, 220, 140, 255), IM_COL32(150, 150, 150, 255),
                         IM_COL32(255, 255, 255, 255), IM_COL32(255, 210, 80, 255),
                         IM_COL32(255, 210, 80, 255)};

/* Radius of a dialog's corners, and distance within which the mouse takes hold of a dot. Both are
 * multiplied by `scale`. */
const float ROUNDING = 4.0F, GRIP = 10.0F;

float scale = 1.0F; /* see ui_scale() */

/* Returns the factor by which fonts and controls are enlarged. On systems that measure windows in
 * pixels, this factor is the scale of the display. On other systems, it is 1, because the
 * framebuffer is already larger than the window by the scale of the display. */
float scale_of(struct GLFWwindow *window) {
    float across = 1.0F, down = 1.0F;
    int width = 0, height = 0, pixels_across = 0, pixels_down = 0;
    glfwGetWindowContentScale(window, &across, &down);
    glfwGetWindowSize(window, &width, &height);
    glfwGetFramebufferSize(window, &pixels_across, &pixels_down);
    const float framebuffer = width > 0 ? (float)pixels_across / (float)width : 1.0F;
    return std::min(std::max(across / std::max(framebuffer, 0.1F), 1.0F), 4.0F);
}

/* Returns the position of a dot on the disk of the hemisphere. The distance from the middle is
 * proportional to the polar angle, which is limited to 90°. */
ImVec2 on_disk(const struct ui_dot *dot, ImVec2 middle, float radius) {
    const double out = std::min(dot->theta_deg, 90.0) / 90.0 * radius;
    const double phi = dot->phi_deg * G_PI / 180.0;
    return ImVec2(middle.x + (float)(out * std::cos(phi)), middle.y - (float)(out * std::sin(phi)));
}

void draw_dot(ImDrawList *list, const struct ui_dot *dot, ImVec2 at) {
    const ImU32 colour = COLOURS[dot->kind];
    switch (dot->kind) {
    case UI_DOT_THERE:
        list->AddCircleFilled(at, 3.0F * scale, colour);
        break;
    case UI_DOT_MISSING:
        list->AddCircle(at, 3.0F * scale, colour);
        break;
    case UI_DOT_CAMERA:
        list->AddLine(ImVec2(at.x - 6.0F * scale, at.y), ImVec2(at.x + 6.0F * scale, at.y), colour,
                      2.0F * scale);
        list->AddLine(ImVec2(at.x, at.y - 6.0F * scale), ImVec2(at.x, at.y + 6.0F * scale), colour,
                      2.0F * scale);
        break;
    case UI_DOT_CHOSEN_LIGHT:
        list->AddCircle(at, 8.0F * scale, colour, 24, 1.5F);
        list->AddCircleFilled(at, 5.0F * scale, colour);
        break;
    case UI_DOT_LIGHT:
        list->AddCircleFilled(at, 5.0F * scale, colour);
        break;
    }
}

} // namespace

extern "C" {

struct Ui {
    ImGuiContext *context;
};

Ui *ui_new(struct GLFWwindow *window) {
    Ui *ui = g_new0(Ui, 1);
    scale = scale_of(window);
    ui->context = ImGui::CreateContext();
    ImGuiIO &io = ImGui::GetIO();
    io.IniFilename = nullptr;
    if (g_file_test(FONT, G_FILE_TEST_EXISTS))
        io.Fonts->AddFontFromFileTTF(FONT, FONT_SIZE * scale, nullptr, RANGES);
    ImGuiStyle &style = ImGui::GetStyle();
    ImGui::StyleColorsDark();
    style.WindowRounding = 0.0F;
    style.FrameRounding = 3.0F;
    style.WindowBorderSize = 0.0F;
    style.ScaleAllSizes(scale);
    ImGui_ImplGlfw_InitForOpenGL(window, true);
    ImGui_ImplOpenGL3_Init("#version 330 core");
    return ui;
}

void ui_free(Ui *ui) {
    if (ui == nullptr)
        return;
    ImGui_ImplOpenGL3_Shutdown();
    ImGui_ImplGlfw_Shutdown();
    ImGui::DestroyContext(ui->context);
    g_free(ui);
}

void ui_begin(Ui *) {
    ImGui_ImplOpenGL3_NewFrame();
    ImGui_ImplGlfw_NewFrame();
    ImGui::NewFrame();
}

void ui_end(Ui *) {
    ImGui::Render();
    ImGui_ImplOpenGL3_RenderDrawData(ImGui::GetDrawData());
}

gboolean ui_wants_mouse(void) {
    return ImGui::GetCurrentContext() != nullptr && ImGui::GetIO().WantCaptureMouse;
}

gboolean ui_wants_keyboard(void) {
    return ImGui::GetCurrentContext() != nullptr && ImGui::GetIO().WantTextInput;
}

float ui_scale(void) {
    return scale;
}

void ui_panel_begin(const char *title, struct ui_box box) {
    ImGui::SetNextWindowPos(ImVec2(box.x, box.y));
    ImGui::SetNextWindowSize(ImVec2(box.width, box.height));
    ImGui::Begin(title, nullptr,
                 ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoResize |
                     ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_NoMove |
                     ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoNav |
                     ImGuiWindowFlags_NoBringToFrontOnFocus);
    ImGui::PushItemWidth(box.width * 0.5F);
}

void ui_dialog_begin(const char *title, struct ui_box within, float width) {
    const float margin = 10.0F * scale, wide = std::min(width, within.width - 2.0F * margin);
    ImGui::SetNextWindowPos(ImVec2(within.x + within.width / 2.0F, within.y + within.height / 2.0F),
                            ImGuiCond_Always, ImVec2(0.5F, 0.5F));
    ImGui::SetNextWindowSizeConstraints(ImVec2(wide, 0.0F),
                                        ImVec2(wide, within.height - 2.0F * margin));
    ImGui::PushStyleVar(ImGuiStyleVar_WindowRounding, ROUNDING * scale);
    ImGui::PushStyleVar(ImGuiStyleVar_WindowBorderSize, 1.0F);
    ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, ImVec2(16.0F * scale, 14.0F * scale));
    ImGui::Begin(title, nullptr,
                 ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoMove |
                     ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_NoNav |
                     ImGuiWindowFlags_NoSavedSettings);
    ImGui::PopStyleVar(3);
    ImGui::PushItemWidth(-1.0F);
}

void ui_bar_begin(struct ui_box within, gboolean takes_mouse) {
    ImGui::SetNextWindowPos(ImVec2(within.x, within.y + within.height), ImGuiCond_Always,
                            ImVec2(0.0F, 1.0F));
    ImGui::SetNextWindowSizeConstraints(ImVec2(within.width, 0.0F),
                                        ImVec2(within.width, within.height));
    ImGui::Begin("message", nullptr,
                 (takes_mouse ? 0 : ImGuiWindowFlags_NoMouseInputs) |
                     ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove |
                     ImGuiWindowFlags_NoNav | ImGuiWindowFlags_NoSavedSettings |
                     ImGuiWindowFlags_NoFocusOnAppearing | ImGuiWindowFlags_AlwaysAutoResize);
    ImGui::PushItemWidth(-1.0F);
}

void ui_button_begin(struct ui_box at) {
    ImGui::SetNextWindowPos(ImVec2(at.x, at.y));
    ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, ImVec2(0.0F, 0.0F));
    ImGui::Begin("fold", nullptr,
                 ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoBackground |
                     ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoNav |
                     ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_AlwaysAutoResize);
    ImGui::PopStyleVar();
    ImGui::PushItemWidth(-1.0F);
}

void ui_end_window(void) {
    ImGui::PopItemWidth();
    ImGui::End();
}

void ui_same_line(void) {
    ImGui::SameLine();
}

void ui_column(float x) {
    ImGui::SameLine(x);
}

void ui_gap(void) {
    ImGui::Spacing();
    ImGui::Separator();
    ImGui::Spacing();
}

gboolean ui_section(const char *title, gboolean open) {
    ImGui::PushID("section"); /* controls of other sections may have the same name */
    const bool unfolded = ImGui::CollapsingHeader(title, open ? ImGuiTreeNodeFlags_DefaultOpen : 0);
    ImGui::PopID();
    return unfolded;
}

gboolean ui_has_glyphs(const char *text) {
    ImFontAtlas atlas;
    const ImFont *font = atlas.AddFontFromFileTTF(FONT, FONT_SIZE, nullptr, RANGES);
    gboolean all = font != nullptr && atlas.Build();
    for (; all && *text != 0; text = g_utf8_next_char(text))
        all = font->FindGlyphNoFallback((ImWchar)g_utf8_get_char(text)) != nullptr;
    return all;
}

void ui_text(const char *text) {
    ImGui::PushTextWrapPos(0.0F);
    ImGui::TextUnformatted(text);
    ImGui::PopTextWrapPos();
}

void ui_note(const char *text) {
    ImGui::PushStyleColor(ImGuiCol_Text, ImVec4(1.0F, 0.8F, 0.3F, 1.0F));
    ui_text(text);
    ImGui::PopStyleColor();
}

gboolean ui_choice(const char *label, const char *const *names, int n, int *chosen) {
    return ImGui::Combo(label, chosen, names, n, n);
}

gboolean ui_slider(const char *label, double *value, double low, double high, const char *format) {
    return ImGui::SliderScalar(label, ImGuiDataType_Double, value, &low, &high, format);
}

gboolean ui_slider_log(const char *label, double *value, double low, double high,
                       const char *format) {
    return ImGui::SliderScalar(label, ImGuiDataType_Double, value, &low, &high, format,
                               ImGuiSliderFlags_Logarithmic);
}

gboolean ui_pair(const char *label, double values[2], double low, double high, const char *format) {
    return ImGui::SliderScalarN(label, ImGuiDataType_Double, values, 2, &low, &high, format);
}

gboolean ui_check(const char *label, gboolean *value) {
    bool on = *value != FALSE;
    const bool changed = ImGui::Checkbox(label, &on);
    *value = on;
    return changed;
}

gboolean ui_button(const char *label) {
    return ImGui::Button(label);
}

gboolean ui_colour(const char *label, float rgb[3]) {
    return ImGui::ColorEdit3(label, rgb, ImGuiColorEditFlags_Float | ImGuiColorEditFlags_HDR);
}

void ui_list_begin(const char *name, float height) {
    ImGui::BeginChild(name, ImVec2(0.0F, height), true);
}

gboolean ui_row(const char *text, gboolean marked) {
    return ImGui::Selectable(text, marked);
}

void ui_list_end(void) {
    ImGui::EndChild();
}

void ui_line(const char *name, char *text, gsize size, gboolean focus) {
    if (focus)
        ImGui::SetKeyboardFocusHere();
    ImGui::PushID(name);
    ImGui::InputText("##line", text, size, ImGuiInputTextFlags_AutoSelectAll);
    ImGui::PopID();
}

void ui_picture(guint texture, float width, float height) {
    ImGui::Image((ImTextureID)GSIZE_TO_POINTER((gsize)texture), ImVec2(width, height));
}

void ui_histogram(const float *values, int n, float width, float height) {
    static const ImU32 colours[3] = {IM_COL32(230, 70, 60, 140), IM_COL32(70, 210, 80, 140),
                                     IM_COL32(80, 120, 255, 140)};
    ImDrawList *list = ImGui::GetWindowDrawList();
    const ImVec2 at = ImGui::GetCursorScreenPos();
    const float step = width / (float)n;
    list->AddRectFilled(at, ImVec2(at.x + width, at.y + height), IM_COL32(0, 0, 0, 160));
    for (int k = 0; k < 3 * n; k++) {
        const float x = at.x + step * (float)(k % n), top = at.y + height * (1.0F - values[k]);
        list->AddRectFilled(ImVec2(x, top), ImVec2(x + step, at.y + height), colours[k / n]);
    }
    ImGui::Dummy(ImVec2(width, height));
}

int ui_hemisphere(const char *name, const struct ui_dot *dots, int n, float size,
                  double *ret_theta_deg, double *ret_phi_deg) {
    static int held = -1; /* the dot that is dragged, and the hemisphere to which it belongs */
    static ImGuiID owner = 0;
    ImDrawList *list = ImGui::GetWindowDrawList();
    const ImVec2 at = ImGui::GetCursorScreenPos(), mouse = ImGui::GetIO().MousePos;
    const ImVec2 middle(at.x + size / 2, at.y + size / 2);
    const float radius = size / 2 - 8 * scale;
    list->AddCircleFilled(middle, size / 2 - 2, IM_COL32(0, 0, 0, 160), 64);
    for (int ring = 1; ring <= 3; ring++)
        list->AddCircle(middle, radius * (float)ring / 3.0F, IM_COL32(90, 90, 90, 255), 64);
    ImGui::InvisibleButton(name, ImVec2(size, size));
    const ImGuiID id = ImGui::GetID(name);
    if (ImGui::IsItemActivated()) {
        float nearest = GRIP * scale;
        owner = id;
        for (int k = 0; k < n; k++) {
            const ImVec2 dot = on_disk(&dots[k], middle, radius);
            const float away = std::hypot(dot.x - mouse.x, dot.y - mouse.y);
            if ((dots[k].kind == UI_DOT_LIGHT || dots[k].kind == UI_DOT_CHOSEN_LIGHT) &&
                away <= nearest) {
                nearest = away;
                held = k;
            }
        }
    }
    if (owner == id && !ImGui::IsItemActive())
        held = -1;
    for (int k = 0; k < n; k++)
        draw_dot(list, &dots[k], on_disk(&dots[k], middle, radius));
    const double x = (double)(mouse.x - middle.x) / radius,
                 y = (double)(middle.y - mouse.y) / radius;
    if (owner != id || held < 0 || held >= n)
        return -1;
    const bool dragged =
        ImGui::IsMouseDragging(ImGuiMouseButton_Left); /* a click only chooses the dot */
    *ret_theta_deg = dragged ? std::min(std::hypot(x, y), 1.0) * 90.0 : dots[held].theta_deg;
    *ret_phi_deg = dragged ? std::atan2(y, x) * 180.0 / G_PI : dots[held].phi_deg;
    return held;
}
}
