//! The settings for writing pictures and the frames of a path.

/// Size and names of the files to write, and the progress of a job that writes them.
pub struct Export {
    /// Width and height in pixels; `None` for those of the window.
    pub size: Option<[u32; 2]>,
    pub picture: String,
    /// The folder for the frames of a path.
    pub folder: String,
    /// The fraction written, 0 to 1; `None` while nothing is written.
    pub progress: Option<f64>,
}

impl Default for Export {
    fn default() -> Self {
        Self { size: None, picture: "view.png".to_owned(), folder: "film".to_owned(), progress: None }
    }
}
