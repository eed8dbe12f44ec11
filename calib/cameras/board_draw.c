/* This file draws a board with cairo. The unit of a PDF is the point (1/72 inch), and the unit of
 * an SVG is the millimetre. */
#include "board.h"

#include "pictures/vision.h"

#include <cairo-pdf.h>
#include <cairo-svg.h>
#include <math.h>

#define POINTS_A_MM (72 / 25.4)
#define MAX_PIXELS  20000

/* Adds the black cells of a marker and its border to the path. x, y is the middle of the marker in
 * the drawing. Adjacent cells of a row are one rectangle, so that no seams appear between them. */
static void add_marker(cairo_t *to, const struct board *board, int marker, double x, double y) {
    guint8 bits[7 * 7] = {0};
    const int n = vision_dictionary(board->dictionary, NULL), border = board_border(board);
    const double cell = board->marker_mm / (n + 2 * border);
    const int first = -border, last = n + border - 1;

    vision_marker_bits(board->dictionary, marker, bits);
    cairo_save(to);
    cairo_translate(to, x, y);
    cairo_scale(to, board->kalibr ? -cell : cell, board->kalibr ? -cell : cell);
    cairo_translate(to, -n / 2.0, -n / 2.0);
    for (int i = first; i <= last; i++)
        for (int j = first, from = first - 1; j <= last + 1; j++) {
            const gboolean is_black =
                j <= last && (i < 0 || i >= n || j < 0 || j >= n || !bits[i * n + j]);
            if (is_black)
                continue;
            if (j > from)
                cairo_rectangle(to, from + 1, i, j - from - 1, 1);
            from = j;
        }
    cairo_restore(to);
}

/* Adds all black squares, markers and circles to the path. x, y is the middle of the board in the
 * drawing. */
static void add_print(cairo_t *to, const struct board *board, double x, double y) {
    const double s = board->square_mm, gap = s - board->marker_mm;
    double corners[4][2];

    for (int row = 0; board->print < BOARD_MARKERS && row < board->rows; row++)
        for (int column = (row + board->white_first) % 2; column < board->columns; column += 2)
            cairo_rectangle(to, x + (column - board->columns / 2.0) * s,
                            y + (row - board->rows / 2.0) * s, s, s);
    for (int row = 0; board->kalibr && row <= board->rows; row++)
        for (int column = 0; column <= board->columns; column++)
            cairo_rectangle(to, x + (column - board->columns / 2.0) * s - gap / 2,
                            y + (row - board->rows / 2.0) * s - gap / 2, gap, gap);
    for (int marker = 0; board_marker_mm(board, marker, corners); marker++)
        add_marker(to, board, marker, x + (corners[0][0] + corners[2][0]) / 2,
                   y - (corners[0][1] + corners[2][1]) / 2);
    for (int id = 0; board->circle_mm > 0 && id < board_n_corners(board); id++) {
        double at[2];
        board_corner_mm(board, id, at);
        cairo_new_sub_path(to);
        cairo_arc(to, x + at[0], y - at[1], board->circle_mm / 2, 0, 2 * G_PI);
    }
}

static cairo_surface_t *new_surface(const char *path, double width_mm, double height_mm,
                                    double pixels_a_mm) {
    if (g_str_has_suffix(path, ".pdf"))
        return cairo_pdf_surface_create(path, width_mm * POINTS_A_MM, height_mm * POINTS_A_MM);
    if (g_str_has_suffix(path, ".svg")) {
        cairo_surface_t *svg = cairo_svg_surface_create(path, width_mm, height_mm);
        cairo_svg_surface_set_document_unit(svg, CAIRO_SVG_UNIT_MM);
        return svg;
    }
    return cairo_image_surface_create(CAIRO_FORMAT_RGB24, (int)lround(width_mm * pixels_a_mm),
                                      (int)lround(height_mm * pixels_a_mm));
}

static cairo_status_t draw_all(const struct board *board, const char *path,
                               const struct board_drawing *drawing) {
    double size[2];
    board_size_mm(board, size);
    const double width = size[0] + 2 * drawing->margin_mm;
    const double height = size[1] + 2 * drawing->margin_mm;
    const gboolean png = g_str_has_suffix(path, ".png");
    const double scale = png                              ? drawing->pixels_a_mm
                         : g_str_has_suffix(path, ".pdf") ? POINTS_A_MM
                                                          : 1;
    cairo_surface_t *surface = new_surface(path, width, height, drawing->pixels_a_mm);
    cairo_t *to = cairo_create(surface);

    /* The unit is now the millimetre, and the origin is the top left of the margin. */
    cairo_scale(to, scale, scale);
    cairo_set_source_rgb(to, 1, 1, 1);
    cairo_paint(to);
    cairo_set_source_rgb(to, 0, 0, 0);
    add_print(to, board, width / 2, height / 2);
    cairo_fill(to);
    cairo_status_t status = cairo_status(to);
    if (status == CAIRO_STATUS_SUCCESS && png)
        status = cairo_surface_write_to_png(surface, path);
    cairo_destroy(to);
    cairo_surface_finish(surface);
    if (status == CAIRO_STATUS_SUCCESS)
        status = cairo_surface_status(surface);
    cairo_surface_destroy(surface);
    return status;
}

gboolean board_draw(const struct board *board, const char *path,
                    const struct board_drawing *drawing, GError **error) {
    double size[2];
    board_size_mm(board, size);
    const double longest_mm = MAX(size[0], size[1]) + 2 * drawing->margin_mm;
    const gboolean png = g_str_has_suffix(path, ".png");
    cairo_status_t status;

    if (!png && !g_str_has_suffix(path, ".svg") && !g_str_has_suffix(path, ".pdf"))
        g_set_error(error, BOARD_ERROR, BOARD_ERROR_SPEC,
                    "%s: the name must end in .svg, .pdf or .png", path);
    else if (png && !(longest_mm * drawing->pixels_a_mm <= MAX_PIXELS))
        g_set_error(error, BOARD_ERROR, BOARD_ERROR_SPEC,
                    "%s: with %g pixels per millimetre, the longer side would have more than %d "
                    "pixels; give fewer",
                    path, drawing->pixels_a_mm, MAX_PIXELS);
    else if ((status = draw_all(board, path, drawing)) != CAIRO_STATUS_SUCCESS)
        g_set_error(error, BOARD_ERROR, BOARD_ERROR_IO,
                    "%s: cannot be written: %s; check that the folder exists and has space", path,
                    cairo_status_to_string(status));
    else
        return TRUE;
    return FALSE;
}
