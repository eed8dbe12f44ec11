Materials are compressed in different ways. The errors themselves are compared in test_lpca.

  $ cp "$SMALL"/*.conf .
  $ mesorig capture rig.conf session.conf -o S >/dev/null
  $ mesorig process S >/dev/null

Local PCA:

  $ mesorig compress S -k 3 --components 2
  S/products/lpca.exr: done in … s: 3 clusters of 2 components, error 3.00 % at the measured directions (3.00 % before rounding), 1.2 kB, 1:5.19 of the BTF in half floats; 4.8 kB on disk
  $ mesorig info S/products/lpca.exr | head -1
  local PCA: 8 × 8 texels, clusters × components 3 × 2 in half, of 4 views × 4 lights, mip levels: 1; error 3.00 % at the measured directions
  $ mesorig compress --json S/products/btf -k 2 --error 50% -q 8bit -o other.exr
  {"file": "other.exr", "method": "lpca", "texels": 64, "views": 4, "lights": 4, "clusters": 2, "components": 1, "grid": 0, "levels": 1, "holes": 0, "lower_bounds": 0, "btf_bytes": 6144, "bytes": 504, "file_bytes": 3812, "exact_error": 0.049, "error": 0.049, "real_s": …, "replaced": false}
  $ mesorig info other.exr | head -1
  local PCA: 8 × 8 texels, clusters × components 2 × 1 in 8bit, of 4 views × 4 lights, mip levels: 1; error 5.00 % at the measured directions
  $ mesorig compress S --grid 5 -k 1 --components 1 -o other.exr --force
  other.exr: done in … s: 1 cluster of 1 component on a grid of 5, error 21.95 % at the measured directions (16.66 % before the grid and rounding), 7.7 kB, 1:0.799 of the BTF in half floats; 10.9 kB on disk
  it replaces the “lpca” that Mesorig had written there
  $ mesorig compress --json S --size 20kB -o other.exr --force | grep -oE '"(error|exact_error)": [0-9.]*|"replaced".*'
  "exact_error": 0.000
  "error": 0.000
  "replaced": true}
  $ mesorig compress S -q packed --error 40% -o other.exr --force
  other.exr: done in … s: 1 cluster of 2 components, error 9.67 % at the measured directions, 3.9 kB on disk, 1:1.56 of the BTF in half floats; 608 bytes unpacked
  it replaces the “lpca” that Mesorig had written there
  $ mesorig compress S -q packed --size 4500B -o packed.exr >/dev/null
  $ test $(stat -c %s packed.exr) -le 4500
  $ mesorig compress S --mips -k 2 --components 1 -o other.exr --force
  other.exr: done in … s: 2 clusters of 1 component, 4 mip levels, error 4.99 % at the measured directions (4.99 % before rounding), 1.6 kB, 1:3.84 of the BTF in half floats; 13.4 kB on disk
  it replaces the “lpca” that Mesorig had written there
  $ mesorig compress S --memory 60MB --colours log -k 1 --components 1 -q 8bit-weights -o other.exr --force
  other.exr: done in … s: 1 cluster of 1 component, error 33.34 % at the measured directions (33.31 % before rounding), 288 bytes, 1:21.3 of the BTF in half floats; 4.0 kB on disk
  it replaces the “lpca” that Mesorig had written there
  $ mesorig compress S -k 1 --components 1 --error 0.0001% --force
  mesorig: an error of 0.0001 % is not reached: with 1 cluster of 1 component it is 16.7 %; allow more clusters or components
  [1]
  $ mesorig compress S --size 10B -o other.exr --force
  mesorig: a size of 10 bytes is too small: one cluster of one component already takes 384 bytes; allow a larger size
  [1]

Memory that is too little is told together with what would be enough.

  $ mesorig compress S --memory 1kB -k 1 --components 1 -o other.exr --force 2>told
  [1]
  $ cat told
  mesorig: 1 cluster of 1 component for 8 × 8 texels, 4 views and 4 lights take 322.1 kB of memory, but --memory allows 1.0 kB; allow more memory, or fewer clusters or components
  $ enough=$(sed -n 's/.*take \([0-9.]*\)[^0-9A-Za-z]*\([kM]B\).*/\1\2/p' told)
  $ mesorig compress S --memory $enough -k 1 --components 1 -o other.exr --force
  other.exr: done in … s: 1 cluster of 1 component, error 16.66 % at the measured directions (16.66 % before rounding), 384 bytes, 1:16 of the BTF in half floats; 3.3 kB on disk
  it replaces the “lpca” that Mesorig had written there

Eigen-maps. A view takes 3 kB as floats.

  $ mesorig compress S -m eigenmaps --components 1 -o other.exr --force
  other.exr: done in … s: 1 eigen-map, error 19.51 % at the measured directions (19.51 % before rounding), 1.6 kB, 1:3.96 of the BTF in half floats; 4.5 kB on disk
  it replaces the existing file
  $ mesorig compress S -m eigenmaps -o matrix.exr
  matrix.exr: done in … s: 4 eigen-maps, error 0.02 % at the measured directions (0.00 % before rounding), 6.2 kB, 1:0.99 of the BTF in half floats; 14.1 kB on disk
  $ cmp matrix.exr S/products/eigenmaps.exr
  $ mesorig compress S -m eigenmaps --memory 7kB --components 1 -o other.exr --force
  other.exr: done in … s: 1 eigen-map, error 19.51 % at the measured directions (19.51 % before rounding), 1.6 kB, 1:3.96 of the BTF in half floats; 4.5 kB on disk
  it replaces the “eigenmaps” that Mesorig had written there
  $ mesorig compress S -m eigenmaps --memory 5kB --components 1 -o other.exr --force
  other.exr: done in … s: 1 eigen-map, error 19.51 % at the measured directions (19.51 % before rounding), 1.6 kB, 1:3.96 of the BTF in half floats; 4.5 kB on disk
  it replaces the “eigenmaps” that Mesorig had written there
  $ mesorig compress S -m eigenmaps --memory 3kB --components 1 -o other.exr --force
  mesorig: --memory gives 3.0 kB, which is too little for one view of 8 × 8 texels and 4 lights; allow at least 3.1 kB
  [1]
  $ mesorig compress S -m eigenmaps --error 99% -o other.exr --force
  other.exr: done in … s: 1 eigen-map, error 19.51 % at the measured directions (19.51 % before rounding), 1.6 kB, 1:3.96 of the BTF in half floats; 4.5 kB on disk
  it replaces the “eigenmaps” that Mesorig had written there
  $ mesorig compress S -m eigenmaps --error 0.0001% --components 1 -o other.exr --force
  mesorig: an error of 0.0001 % is not reached: with 1 eigen-map it is 19.5 %; allow more eigen-maps or a larger error
  [1]

Other methods:

  $ mesorig compress S --method fields --components 1
  S/products/fields.exr: done in … s: fields of 1 lobe, luminance off by 0.0014 on average, error 0.66 % at the measured directions (0.66 % before rounding), 3.6 kB, 1:1.71 of the BTF in half floats; 5.5 kB on disk
  $ mesorig info S/products/fields.exr | head -1
  fields of 1 lobe: 8 × 8 texels, of 4 views × 4 lights; at the measured directions: error 0.66 %, luminance off by 0.0014
  $ mesorig compress --json S -m ashikhmin
  {"file": "S/products/ashikhmin.exr", "method": "ashikhmin", "texels": 64, "views": 4, "lights": 4, "clusters": 0, "components": 0, "grid": 0, "levels": 1, "holes": 0, "lower_bounds": 0, "btf_bytes": 6144, "bytes": 1792, "file_bytes": 4981, "exact_error": 0.059, "error": 0.059, "luminance_error": 0.006, "real_s": …, "replaced": false}
  $ mesorig compress S -m ptm --mips -o other.exr --force
  other.exr: done in … s: ptm, 4 mip levels, luminance off by 0.0014 on average, error 0.66 % at the measured directions (0.66 % before rounding), 6.1 kB, 1:1 of the BTF in half floats; 14.3 kB on disk
  it replaces the existing file
  $ mesorig compress S -m ptm --error 0.0001%
  mesorig: an error of 0.0001 % is not reached: ptm has an error of 0.66 %; allow a larger error or use --method=lpca
  [1]
  $ mesorig compress S -m fields --components 4
  mesorig: fields cannot have 4 lobes; give 1 to 3 lobes
  [1]
  $ mesorig compress S -m neural --components 8 --mips | sed 's/[0-9.]*[^0-9., ]*kB/…/g; s/off by [0-9.]*/off by …/; s/[0-9.]* %/… %/g; s/1:[0-9.e-]*/1:…/'
  S/products/neural.exr: done in … s: neural planes of 8 channels, with relief, 4 mip levels, luminance off by … on average, error … % at the measured directions (… % before rounding), …, 1:… of the BTF in half floats; … on disk
  $ mesorig info S/products/neural.exr | head -1 | sed 's/error .*/error …/'
  neural planes of 8 channels: 8 × 8 texels, of 4 views × 4 lights; at the measured directions: error …
  $ mesorig compress S -m neural --components 6
  mesorig compress: --components must be 4, 8, 12 or 16
  Usage: mesorig compress DIR
  [2]

Places where nothing can be written:

  $ mesorig compress S -o /no/such/folder/x.exr
  mesorig: /no/such/folder/x.exr: cannot be written: there is no folder /no/such/folder; make it first
  [1]

What does not go together:

  $ mesorig compress S -m ptm --memory 7kB
  mesorig compress: --method=ptm has no option --memory: leave that option out, or choose a method that has it: lpca, eigenmaps
  Usage: mesorig compress DIR
  [2]
  $ mesorig compress S -m eigenmaps --mips -o other.exr
  mesorig compress: --method=eigenmaps has no option --mips: leave that option out, or choose a method that has it: lpca, fields, * (glob)
  Usage: mesorig compress DIR
  [2]
  $ mesorig compress S -m ward -k 2
  mesorig compress: --method=ward has no option --clusters: leave that option out, or choose a method that has it: lpca
  Usage: mesorig compress DIR
  [2]
  $ mesorig compress S --memory little
  mesorig compress: --memory: "little" is not a size such as 20MB or 500kB, of at least 1 byte
  Usage: mesorig compress DIR
  [2]
  $ mesorig compress S --colours xyz
  mesorig compress: --colours: there is no "xyz"; choose from: rgb, log
  Usage: mesorig compress DIR
  [2]
  $ mesorig compress S --colours log --grid 8
  mesorig compress: --grid needs --colours=rgb
  Usage: mesorig compress DIR
  [2]
  $ mesorig compress S --memory 60MB --mips
  mesorig compress: --mips takes the whole BTF into memory: leave out --memory
  Usage: mesorig compress DIR
  [2]
  $ mesorig compress S --size large
  mesorig compress: --size: "large" is not a size such as 20MB or 500kB, of at least 1 byte
  Usage: mesorig compress DIR
  [2]
  $ mesorig compress S --size 20kB -k 2
  mesorig compress: --size chooses the clusters: leave out -k
  Usage: mesorig compress DIR
  [2]
  $ mesorig compress S --grid 1000
  mesorig compress: --grid: 1000 is out of range: 4 to 24
  Usage: mesorig compress DIR
  [2]
  $ mesorig compress S --grid 8 -m ptm
  mesorig compress: --method=ptm has no option --grid: leave that option out, or choose a method that has it: lpca
  Usage: mesorig compress DIR
  [2]
  $ mesorig compress S -m wavelets
  mesorig compress: there is no --method=wavelets; choose from: lpca, eigenmaps, *, mdf, mdf-views (glob)
  Usage: mesorig compress DIR
  [2]
  $ mesorig compress S -m eigenmaps
  mesorig compress: --method=eigenmaps: give -o FILE, because “mesorig process” writes the session's own file of this method, which must not be replaced
  Usage: mesorig compress DIR
  [2]
  $ mesorig compress S --error many
  mesorig compress: --error: "many" is not a share between 0 and 1, such as 2% or 0.02
  Usage: mesorig compress DIR
  [2]
  $ mesorig compress S -q 4bit
  mesorig compress: --quantise: there is no "4bit"; choose from: float, half, 8bit, 8bit-weights, packed
  Usage: mesorig compress DIR
  [2]
  $ mesorig compress S -k 0
  mesorig compress: --clusters: 0 is out of range: 1 to 1024
  Usage: mesorig compress DIR
  [2]
  $ mesorig compress S -q packed -o other.exr
  mesorig compress: --quantise=packed needs either --error or --size
  Usage: mesorig compress DIR
  [2]
  $ mesorig compress S -q packed --error 40% --mips -o other.exr
  mesorig compress: --quantise=packed cannot be combined with -k, --grid, --mips or --colours=log
  Usage: mesorig compress DIR
  [2]

Models are compared with the BTF that they are of.

  $ mesorig compare S other.exr | head -6 | grep -v ^evaluation
  A          S, btf, 6.1 kB, 96 bytes per texel
  B          other.exr, ptm, 4.6 kB, 72 bytes per texel, 1:1.33
  error      0.660 % (RMS of R, G, B relative to A) at the measured directions
  luminance  off by 0.00139 on average
  ΔE         0.310 on average (CIEDE2000, white is the diffuser)
  $ mesorig compare S S/products/fields.exr --plot plot.png | grep -E '^(error|plot) '
  error      0.662 % (RMS of R, G, B relative to A) at the measured directions
  error bars not known
  plot       plot.png
  $ mesorig compare --json S S/products/lpca.exr | python3 -m json.tool --json-lines >/dev/null
  $ mesorig compare S --curve curve.svg --leave-out 0 | grep -E 'fields  *[12] lobe|eigen|curve.svg'
  eigen-maps               1 term         1:3.959     19.505 %
  eigen-maps               2 terms        1:1.979      6.858 %
  eigen-maps               4 terms        1:0.9897     0.000 %
  reflectance fields       1 lobe         1:1.714      0.662 %
  reflectance fields       2 lobes        1:1.091      0.385 %
  plot curve.svg
  $ mesorig compare --json S --curve curve.svg --leave-out 0 --force | grep -o '"series": "local PCA, packed", "label": "2 components"' | head -1
  "series": "local PCA, packed", "label": "2 components"
  $ ls plot.png curve.svg
  curve.svg
  plot.png
  $ mesorig compare S S/products/fields.exr --plot /no/such/folder/x.png
  mesorig: /no/such/folder/x.png: cannot be written: there is no folder /no/such/folder; make it first
  [1]
  $ mesorig compare S S/products/fields.exr --plot plot.jpg
  mesorig: plot.jpg: the name of a plot must end in .png or .svg
  [1]
  $ mesorig compare S/products/fields.exr --curve curve.svg --force
  mesorig: S/products/fields.exr: --curve needs the BTF of a session: give a session directory that “mesorig process” has processed
  [1]
  $ mesorig compare S --plot curve.svg
  mesorig compare: --plot draws the errors between two materials: give two
  Usage: mesorig compare A B | DIR | DIR --curve FILE
  [2]
  $ mesorig compare S S/products/fields.exr --curve curve.svg
  mesorig compare: --curve is for one session: give only one
  Usage: mesorig compare A B | DIR | DIR --curve FILE
  [2]

A file that was cut short:

  $ truncate -s -10 packed.exr
  $ mesorig info packed.exr
  mesorig: packed.exr: not a valid EXR file: * (glob)
  [1]
  $ mesorig compare S packed.exr
  mesorig: packed.exr: not a valid EXR file: * (glob)
  [1]
