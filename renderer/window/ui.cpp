#include <glib.h>

extern "C" {
#include "ui.h"
}

#include <algorithm>
#include <cmath>

#include <imgui.h>

#include <backends/imgui_impl_glfw.h>
#include <backends/imgui_impl_opengl3.h>

namespace {

const char *const FONT = "/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf";
const float FONT_SIZE = 15.0F;

/* Latin and Greek letters, dashes, dots and quotation marks, and what formulas need: sub- and
 * superscripts, arrows, operators. */
const ImWchar RANGES[] = {0x20,   0x24F,  0x370,  0x3FF,  0x2010, 0x2026, 0x2070,
                          0x209C, 0x2190, 0x2194, 0x2200, 0x2265, 0};

const ImU32 COLOURS[] = {IM_COL32(120, 220, 140, 255), IM_COL32(150, 150, 150, 255),
                         IM_COL32(255, 255, 255, 255), IM_COL32(255, 210, 80, 255)};

/* Equal steps of the polar angle are equal steps outwards. */
ImVec2 on_disk(const struct ui_dot *dot, ImVec2 middle, float radius) {
    const double out = std::min(dot->theta_deg, 90.0) / 90.0 * radius;
    const double phi = dot->phi_deg * G_PI / 180.0;
    return ImVec2(middle.x + (float)(out * std::cos(phi)), middle.y - (float)(out * std::sin(phi)));
}

void draw_dot(ImDrawList *list, const struct ui_dot *dot, ImVec2 at) {
    const ImU32 colour = COLOURS[dot->kind];
    switch (dot->kind) {
    case UI_DOT_THERE:
        list->AddCircleFilled(at, 3.0F, colour);
        break;
    case UI_DOT_MISSING:
        list->AddCircle(at, 3.0F, colour);
        break;
    case UI_DOT_CAMERA:
        list->AddLine(ImVec2(at.x - 6, at.y), ImVec2(at.x + 6, at.y), colour, 2.0F);
        list->AddLine(ImVec2(at.x, at.y - 6), ImVec2(at.x, at.y + 6), colour, 2.0F);
        break;
    case UI_DOT_LIGHT:
        list->AddCircleFilled(at, 5.0F, colour);
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
    ui->context = ImGui::CreateContext();
    ImGuiIO &io = ImGui::GetIO();
    io.IniFilename = nullptr;
    if (g_file_test(FONT, G_FILE_TEST_EXISTS))
        io.Fonts->AddFontFromFileTTF(FONT, FONT_SIZE, nullptr, RANGES);
    ImGuiStyle &style = ImGui::GetStyle();
    ImGui::StyleColorsDark();
    style.WindowRounding = 4.0F;
    style.FrameRounding = 3.0F;
    style.Colors[ImGuiCol_WindowBg].w = 0.85F;
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

void ui_panel_begin(const char *title, float x, float y, float width) {
    ImGui::SetNextWindowPos(ImVec2(x, y), ImGuiCond_FirstUseEver);
    ImGui::SetNextWindowSizeConstraints(ImVec2(width, 0.0F), ImVec2(width, G_MAXFLOAT));
    ImGui::Begin(title, nullptr, ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoNav);
    ImGui::PushItemWidth(width * 0.55F);
}

void ui_panel_end(void) {
    ImGui::PopItemWidth();
    ImGui::End();
}

gboolean ui_section(const char *title, gboolean open) {
    return ImGui::CollapsingHeader(title, open ? ImGuiTreeNodeFlags_DefaultOpen : 0);
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

gboolean ui_check(const char *label, gboolean *value) {
    bool on = *value != FALSE;
    const bool changed = ImGui::Checkbox(label, &on);
    *value = on;
    return changed;
}

gboolean ui_button(const char *label) {
    return ImGui::Button(label);
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

void ui_hemisphere(const struct ui_dot *dots, int n, float size) {
    ImDrawList *list = ImGui::GetWindowDrawList();
    const ImVec2 at = ImGui::GetCursorScreenPos();
    const ImVec2 middle(at.x + size / 2, at.y + size / 2);
    const float radius = size / 2 - 8;
    list->AddCircleFilled(middle, size / 2 - 2, IM_COL32(0, 0, 0, 160), 64);
    for (int ring = 1; ring <= 3; ring++)
        list->AddCircle(middle, radius * (float)ring / 3.0F, IM_COL32(90, 90, 90, 255), 64);
    for (int k = 0; k < n; k++)
        draw_dot(list, &dots[k], on_disk(&dots[k], middle, radius));
    ImGui::Dummy(ImVec2(size, size));
}
}
