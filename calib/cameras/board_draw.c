/* Draws a board with cairo; PDF units are points (1/72 inch), SVG units millimetres. */
#include "board.h"

#include "pictures/vision.h"

#include <cairo-pdf.h>
#include <cairo-svg.h>
#include <math.h>

#define POINTS_A_MM (72 / 25.4)
#define MAX_PIXELS  20000

/* Draws the black cells of a marker with its border. Adjacent cells of a row are one rectangle,
 * so that no seams appear between them. */
static void add_marker(cairo_t *to, const struct board *board, int marker, double x, double y) {
    guint8 bits[7 * 7] = {0};
    const int n = vision_dictionary(board->dictionary, NULL);
    const double cell = board->marker_mm / (n + 2);

    vision_marker_bits(board->dictionary, marker, bits);
    for (int i = -1; i <= n; i++)
        for (int j = -1, from = -1; j <= n + 1; j++) {
            const gboolean is_black =
                j <= n && (i < 0 || i == n || j < 0 || j == n || !bits[i * n + j]);
            if (is_black)
                continue;
            if (j > from)
                cairo_rectangle(to, x + (from + 1) * cell, y + (i + 1) * cell, (j - from) * cell,
                                cell);
            from = j + 1;
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
    const double s = board->square_mm, inset = (s - board->marker_mm) / 2;
    const double margin = drawing->margin_mm; /* units: millimetres from the top left of it */
    const double width = board->columns * s + 2 * margin, height = board->rows * s + 2 * margin;
    const gboolean png = g_str_has_suffix(path, ".png");
    const double scale = png                              ? drawing->pixels_a_mm
                         : g_str_has_suffix(path, ".pdf") ? POINTS_A_MM
                                                          : 1;
    cairo_surface_t *surface = new_surface(path, width, height, drawing->pixels_a_mm);
    cairo_t *to = cairo_create(surface);
    int column, row;

    cairo_scale(to, scale, scale);
    cairo_set_source_rgb(to, 1, 1, 1);
    cairo_paint(to);
    cairo_set_source_rgb(to, 0, 0, 0);
    for (row = 0; row < board->rows; row++)
        for (column = row % 2; column < board->columns; column += 2)
            cairo_rectangle(to, margin + column * s, margin + row * s, s, s);
    for (int marker = 0; board_marker_square(board, marker, &column, &row); marker++)
        add_marker(to, board, marker, margin + column * s + inset, margin + row * s + inset);
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
    const double longest_mm =
        MAX(board->columns, board->rows) * board->square_mm + 2 * drawing->margin_mm;
    const gboolean png = g_str_has_suffix(path, ".png");
    cairo_status_t status;

    if (!png && !g_str_has_suffix(path, ".svg") && !g_str_has_suffix(path, ".pdf"))
        g_set_error(error, BOARD_ERROR, BOARD_ERROR_SPEC,
                    "%s: the name must end in .svg, .pdf or .png", path);
    else if (png && !(longest_mm * drawing->pixels_a_mm <= MAX_PIXELS))
        g_set_error(error, BOARD_ERROR, BOARD_ERROR_SPEC,
                    "%s: %g pixels per millimetre make a picture larger than %d pixels", path,
                    drawing->pixels_a_mm, MAX_PIXELS);
    else if ((status = draw_all(board, path, drawing)) != CAIRO_STATUS_SUCCESS)
        g_set_error(error, BOARD_ERROR, BOARD_ERROR_IO, "%s: cannot be written: %s", path,
                    cairo_status_to_string(status));
    else
        return TRUE;
    return FALSE;
}
