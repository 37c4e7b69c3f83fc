//! Pictures made of cells in few colours, for the maps of the report.
//!
//! In: cells, row by row, each an index into a palette. Out: an indexed PNG as bytes, or as a
//! `data:` address that stands in a page, so that the page needs no file beside it.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

/// Red, green, blue.
pub type Colour = [u8; 3];

/// A picture of `width` x `height` cells, row by row, each an index into `palette`.
#[derive(Clone, Debug)]
pub struct Raster<'a> {
    pub width: u32,
    pub height: u32,
    /// At most 16 colours, since a cell has four bits in the file.
    pub palette: &'a [Colour],
    pub cells: &'a [u8],
}

impl Raster<'_> {
    /// The picture as the bytes of a PNG file. Fails if cells are none, too many, too few or beyond the
    /// palette.
    pub fn png(&self) -> Result<Vec<u8>, String> {
        let inside = |cell: &u8| usize::from(*cell) < self.palette.len();
        if self.palette.len() > 16 || !self.cells.iter().all(inside) {
            return Err(format!("cells beyond a palette of {} colours", self.palette.len()));
        }
        if self.cells.len() != self.width as usize * self.height as usize || self.cells.is_empty() {
            let Raster { width, height, .. } = self;
            return Err(format!("{} cells, not {width} x {height}", self.cells.len()));
        }
        // two cells in a byte, the first in the upper half; the last cell of an odd row stands alone
        let pair = |cells: &[u8]| cells[0] << 4 | cells.get(1).copied().unwrap_or(0);
        let rows = self.cells.chunks(self.width as usize);
        let packed: Vec<u8> = rows.flat_map(|row| row.chunks(2).map(pair)).collect();
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width, self.height);
        encoder.set_color(png::ColorType::Indexed);
        encoder.set_depth(png::BitDepth::Four);
        encoder.set_palette(self.palette.concat());
        encoder.set_compression(png::Compression::High);
        encoder.set_filter(png::Filter::NoFilter);
        let written = encoder
            .write_header()
            .and_then(|mut writer| writer.write_image_data(&packed).and_then(|()| writer.finish()));
        written.map_err(|e| e.to_string())?;
        Ok(bytes)
    }

    /// The picture as an address for the `src` or `href` of an image, `data:image/png;base64,...`
    pub fn address(&self) -> Result<String, String> {
        Ok(format!("data:image/png;base64,{}", STANDARD.encode(self.png()?)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PALETTE: [Colour; 3] = [[255, 255, 255], [200, 0, 0], [0, 0, 200]];

    #[test]
    fn cells_written_are_cells_read_back() {
        let cells: Vec<u8> = (0..7 * 5).map(|k| (k % 3) as u8).collect();
        let raster = Raster { width: 7, height: 5, palette: &PALETTE, cells: &cells };
        let bytes = raster.png().unwrap();
        let mut decoder = png::Decoder::new(std::io::Cursor::new(&bytes));
        decoder.set_transformations(png::Transformations::EXPAND);
        let mut reader = decoder.read_info().unwrap();
        let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut rgb).unwrap();
        let expected: Vec<u8> = cells.iter().flat_map(|c| PALETTE[usize::from(*c)]).collect();
        assert_eq!(rgb, expected);
        assert!(raster.address().unwrap().starts_with("data:image/png;base64,iVBORw0KGgo"));
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let raster = |cells| Raster { width: 2, height: 1, palette: &PALETTE, cells };
        assert!(raster(&[0, 3]).png().is_err());
        assert!(raster(&[0]).png().is_err());
    }
}
