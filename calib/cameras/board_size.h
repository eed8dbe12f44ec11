/*
 * Detects a wrong size of the board while pictures are searched for it. The size is the most common
 * mistake in the description of a board: corners are counted instead of squares, or one square too
 * many is counted. A search for a board that is not there takes minutes, and its failure does not
 * say why.
 *
 * A few of the pictures are therefore searched for a board of the given print and any size. A
 * picture counts only if it shows the white margin along all four sides of the board. Without this
 * condition, a board that is partly covered or partly outside the picture would be taken for a
 * smaller one. If two pictures (three for a grid of markers or circles) show the same other size,
 * and none shows the given one, the search ends with an error that names the size. Each picture
 * that shows a third size raises the number of pictures needed by two.
 *
 * Chessboards and symmetric grids of circles look the same if columns and rows are exchanged, so
 * for these the order is not compared. Boards of less than 4 × 4 squares or 3 × 3 circles are not
 * recognised, and neither are boards without a margin. Such boards give no error here. Only a
 * chessboard that has as many inner corners as the given one has squares is recognised without a
 * margin.
 *
 * Any thread may call the functions. Several threads may use one census at the same time.
 */
#pragma once

#include "board_find.h"

struct board_census;

/* Starts a census with the description of the board, which is copied. */
struct board_census *board_census_new(const struct board *given);
void board_census_free(struct board_census *census); /* NULL is ignored */
typedef struct board_census BoardCensus;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(BoardCensus, board_census_free)

/* Examines a picture before the search. The picture is examined only if the board has no markers
 * and the picture is so large that a failed search takes seconds. *ret_more is TRUE if another
 * picture with as many pixels should be examined in the same way. Once a picture has shown the
 * given size of the board, or enough pictures were examined, further calls return immediately.
 *
 * Returns FALSE with BOARD_ERROR_SPEC if the pictures examined so far show another size of the
 * board. The error names that size. */
gboolean board_census_before(struct board_census *census, const struct picture *picture,
                             gboolean *ret_more, GError **error);

/* Examines a picture after board_find(). corners is NULL if nothing was found. The picture is
 * examined if nothing was found, or if the board goes on beyond the corners. Returns FALSE like
 * board_census_before(). */
gboolean board_census_after(struct board_census *census, const struct picture *picture,
                            const GArray *corners, GError **error);

/* Measures the number of columns and rows of the board in one picture. The board has the given
 * print. Tests use this function to count how often the size is right. If the print looks the same
 * with columns and rows exchanged, the larger number is returned as columns if given->columns ≥
 * given->rows, and else as rows. Returns FALSE if the size is not known, or if the board does not
 * end within the picture. */
gboolean board_measure(const struct picture *picture, const struct board *given, int *ret_columns,
                       int *ret_rows);
