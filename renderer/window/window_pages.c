/* Dialogs over the picture, and the line of text at its bottom. */
#include "recent.h"
#include "window_private.h"

static void set_message(struct window *w, const char *message, gboolean is_error) {
    char *copy = g_strdup(message); /* message may be w->message itself */
    g_free(w->message);
    w->message = copy;
    w->is_error = is_error && message != NULL;
    w->frames_due = WINDOW_FRAMES;
}

void window_say(struct window *w, const char *error) {
    if (error != NULL)
        g_printerr("mesorig-view: %s\n", error);
    set_message(w, error, TRUE);
}

void window_tell(struct window *w, const char *sentence) {
    set_message(w, sentence, FALSE);
}

void window_show_page(struct window *w, enum window_page page) {
    if (w->page == WINDOW_FILES && page != WINDOW_FILES)
        window_files_clear(w);
    if (page == WINDOW_START) {
        g_clear_pointer(&w->recent, g_ptr_array_unref);
        w->recent = recent_list();
    }
    w->page = page;
    w->frames_due = WINDOW_FRAMES;
}

static void draw_start(struct window *w, struct ui_box picture) {
    const char *sample = viewer_options_sample();
    int chosen = -1;
    ui_dialog_begin("Mesorig", picture, 460.0F * ui_scale());
    ui_text("Open a session that mesorig has captured, a file made from one, a shape or an "
            "environment map, or drop it here.");
    ui_gap();
    if (ui_button("Open a session …"))
        window_ask_file(w, CHOOSER_FOLDER);
    ui_same_line();
    if (ui_button("Open a file …"))
        window_ask_file(w, CHOOSER_FILE);
    ui_same_line();
    const gboolean looks =
        ui_button(sample != NULL ? "Look at the sample" : "Look at woven fabric");
    if (looks && sample == NULL)
        window_show_page(w, WINDOW_NO_PAGE);
    ui_gap();
    ui_text(w->recent->len > 0 ? "Opened last:" : "Nothing was opened yet.");
    for (guint k = 0; k < w->recent->len; k++) {
        g_autofree char *shown = g_filename_display_name(w->recent->pdata[k]);
        g_autofree char *row = g_strdup_printf("%u   %s", k + 1, shown);
        if (ui_row(row, FALSE))
            chosen = (int)k;
    }
    ui_end_window();
    if (looks && sample != NULL)
        window_open(w, sample);
    else if (chosen >= 0)
        window_open(w, w->recent->pdata[chosen]);
}

static void draw_keys(const struct window *w, struct ui_box picture) {
    ui_dialog_begin("Keys", picture, 520.0F * ui_scale());
    for (const struct window_key *key = window_keys; key->keys != NULL; key++) {
        ui_note(key->keys);
        ui_column(170.0F * ui_scale());
        ui_text(key->does);
    }
    ui_end_window();
}

/* An error stays until the user closes it, or until the same action succeeds. Any other message
 * stays until the next key or button. */
static void draw_message(struct window *w, struct ui_box picture) {
    gboolean closed = FALSE;
    ui_bar_begin(picture, w->is_error);
    if (w->is_error) {
        closed = ui_button("×");
        ui_same_line();
        ui_note(w->message);
    } else {
        ui_text(w->message);
    }
    ui_end_window();
    if (closed)
        set_message(w, NULL, FALSE);
}

void window_draw_pages(struct window *w, struct ui_box picture) {
    if (w->opener == NULL) /* the first picture */
        return;
    if (w->page == WINDOW_START)
        draw_start(w, picture);
    else if (w->page == WINDOW_KEYS)
        draw_keys(w, picture);
    else if (w->page == WINDOW_FILES)
        window_files_draw(w, picture);
    if (!window_has_panel(w)) {
        ui_button_begin((struct ui_box){picture.x, picture.y, 0.0F, 0.0F});
        if (ui_button("»")) {
            w->panel = TRUE;
            w->frames_due = WINDOW_FRAMES;
        }
        ui_end_window();
    }
    if (w->message != NULL)
        draw_message(w, picture);
}
