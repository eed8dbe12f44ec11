Errors of compression at directions that it has not seen. The times, in the last column, differ from run to run.

  $ cp "$SMALL"/*.conf .
  $ mesorig capture rig.conf session.conf -o S >/dev/null
  $ mesorig process S >/dev/null
  $ methods() { mesorig compare "$@" | sed 's/ *[0-9]*$//'; }
  $ known='lpca|eigenmaps|fields|ptm|hsh|lafortune|ward|ashikhmin' # a new codec adds a line
  $ methods S | grep -E "^([^a-z]|method|btf|$known|$)"
  S: 4 views × 4 lights
  1 view and 1 light were left out (seed 1). Errors are those at 1 pair of a view and a light that no method has seen.
  SSIM and FLIP are means over 1 picture.
  
  method       bytes/texel     error      seen  PSNR/dB    SSIM    FLIP     ΔE     ns
  btf                 54.0   10.61 %    0.00 %    30.66       –  0.1251   2.92
  lpca               260.0   10.61 %    0.02 %    30.66       –  0.1251   2.92
  eigenmaps           54.6   10.61 %    0.02 %    30.66       –  0.1251   2.92
  fields              66.0   15.00 %    0.37 %    28.88       –  0.1296   3.38
  ptm                 54.0   11.43 %    0.37 %    29.85       –  0.1453   3.20
  hsh                162.0   14.02 %    0.01 %    28.37       –  0.1762   3.84
  lafortune           24.0   20.8? %   18.6? %    24.5?       *  0.19??   4.5? (esc) (glob)
  ward                28.0   25.?? %    5.1? %    22.??       *  0.26??   4.6? (esc) (glob)
  ashikhmin           28.0   20.3? %    6.1? %    23.4?       *  0.20??   4.4? (esc) (glob)
  $ methods S --leave-out lights=1 -m hsh | sed 1,4d
  method       bytes/texel     error      seen  PSNR/dB    SSIM    FLIP     ΔE     ns
  btf                 72.0   26.66 %    0.00 %    21.29       –  0.3255   6.65
  hsh                216.0   86.75 %    0.01 %     7.85       –  0.8520  40.17
  $ methods S --leave-out views=1 --seed 7 -m ptm
  S: 4 views × 4 lights
  1 view and 0 lights were left out (seed 7). Errors are those at 4 pairs of a view and a light that no method has seen.
  SSIM and FLIP are means over 4 pictures.
  
  method       bytes/texel     error      seen  PSNR/dB    SSIM    FLIP     ΔE     ns
  btf                 72.0   18.81 %    0.00 %    20.79       –  0.1831   4.56
  ptm                 54.0   18.81 %    0.64 %    20.80       –  0.1833   4.53
  $ methods S --leave-out 0 -m eigenmaps | cut -c1-44
  S: 4 views × 4 lights
  Errors are those at all 16 measured pairs of
  SSIM and FLIP are means over 16 pictures.
  
  method       bytes/texel     error      seen
  btf                 96.0    0.00 %    0.00 %
  eigenmaps           97.0    0.00 %    0.02 %
  $ mesorig compare S --leave-out 1 -m lpca --json | sed 's/"evaluation_ns": [0-9.]*/"evaluation_ns": …/g'
  {"session": "S", "views": 4, "lights": 4, "seed": 1, "pairs": 1, "left_out_views": [{"index": 1, "theta_deg": 30, "phi_deg": 180}], "left_out_lights": [{"index": 3, "theta_deg": 60, "phi_deg": 225}], "pictures": 1, "methods": [{"method": "btf", "bytes_per_texel": 54, "error": 0.106, "seen": 0, "psnr_db": 30.658, "ssim": null, "flip": 0.125, "delta_e": 2.916, "evaluation_ns": …, "luminance_error": 0.012, "largest": 0.091}, {"method": "lpca", "bytes_per_texel": 260, "error": 0.106, "seen": 0.000, "psnr_db": 30.657, "ssim": null, "flip": 0.125, "delta_e": 2.916, "evaluation_ns": …, "luminance_error": 0.012, "largest": 0.091}]}
  $ mesorig compare S --leave-out 2
  mesorig: S: 2 of 4 views cannot be left out, because at least 3 must be kept; leave out fewer views
  [1]
  $ mesorig compare S --leave-out each
  mesorig: S: the session has pictures under 4 lights; to predict each from the others, at least 5 are needed; capture or import pictures under more lights
  [1]
  $ mesorig compare S --leave-out each -m hsh
  mesorig compare: --leave-out=each compares ways to predict a light, not methods of compression: leave out --method, --curve and --seed
  Usage: mesorig compare A B | DIR | DIR --curve FILE
  [2]
  $ mesorig compare S --leave-out views=-1
  mesorig compare: --leave-out=views=-1: give a number, such as 4, views=4 or lights=4, or give each
  Usage: mesorig compare A B | DIR | DIR --curve FILE
  [2]
  $ mesorig compare S --leave-out texels=1
  mesorig compare: --leave-out=texels=1: give a number, such as 4, views=4 or lights=4, or give each
  Usage: mesorig compare A B | DIR | DIR --curve FILE
  [2]
  $ mesorig compare S -m wavelets
  mesorig compare: there is no --method=wavelets; “mesorig compare --help” lists the methods
  Usage: mesorig compare A B | DIR | DIR --curve FILE
  [2]
  $ mesorig compare S -m lpca --curve curve.svg
  mesorig compare: give --method or --curve, not both
  Usage: mesorig compare A B | DIR | DIR --curve FILE
  [2]

Error against size, at directions that were left out and at the measured ones:

  $ mesorig compare S --curve curve.svg | grep -E 'left out|eigen|curve.svg'
  1 view and 1 light were left out (seed 1). Errors are those at 1 pair of a view and a light that no method has seen.
  eigen-maps               1 term         1:2.969     18.882 %
  eigen-maps               2 terms        1:1.485     11.492 %
  plot curve.svg
  $ mesorig compare S --curve curve.svg --leave-out 0 --force | grep -E 'measured|eigen'
  Errors are those at all 16 measured pairs of a view and a light, which every method has seen.
  eigen-maps               1 term         1:3.959     19.505 %
  eigen-maps               2 terms        1:1.979      6.858 %
  eigen-maps               4 terms        1:0.9897     0.000 %

Both forms of a material at the measured directions:

  $ mesorig compare S S/products/eigenmaps.exr | head -10 | grep -v ^evaluation
  A          S, btf, 6.1 kB, 96 bytes per texel
  B          eigenmaps.exr, eigenmaps, 6.2 kB, 97 bytes per texel, 1:0.99
  error      0.019 % (RMS of R, G, B relative to A) at the measured directions
  luminance  off by 0.00004 on average
  ΔE         0.015 on average (CIEDE2000, white is the diffuser)
  PSNR       83.31 dB of all values, clipped to white, as sRGB
  FLIP       0.0010 on average of 16 pictures
  largest    0.0002
  error bars not known
  $ mesorig compare S/products/eigenmaps.exr
  mesorig: S/products/eigenmaps.exr: no session there: it is a file; give the directory of a session
  [1]
  $ mesorig compare S S/products/eigenmaps.exr --seed 2
  mesorig compare: --leave-out and --seed need one session, whose BTF is compressed without some directions
  Usage: mesorig compare A B | DIR | DIR --curve FILE
  [2]

Pictures. scikit-image 0.26.0 and flip-evaluator 1.7 give 26.609 dB, 0.90495 and 0.17931.

  $ python3 - <<'END'
  > import struct, zlib
  > def chunk(name, data):
  >     return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
  > for name, step in ("a", 8), ("b", 9):
  >     rows = b"".join(b"\0" + bytes(min(x * step, 255) for x in range(60)) for y in range(16))
  >     with open(name + ".png", "wb") as file:
  >         file.write(bytes((137, 80, 78, 71, 13, 10, 26, 10)) + chunk(b"IHDR", struct.pack(">IIBBBBB", 20, 16, 8, 2, 0, 0, 0)))
  >         file.write(chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))
  > END
  $ mesorig compare a.png b.png
  ΔE         2.352 on average (CIEDE2000), 4.277 where they differ: 95 % below 6.402, at most 6.402
             55.0 % of 20 × 16 pixels differ
  PSNR       26.61 dB
  SSIM       0.9050
  FLIP       0.1793
  $ mesorig compare --json a.png a.png
  {"a": "a.png", "b": "a.png", "delta_e": 0, "delta_e_different": 0, "delta_e_p95": 0, "delta_e_largest": 0, "different": 0, "psnr_db": null, "ssim": 1, "flip": 0, "flip_hdr": null}
