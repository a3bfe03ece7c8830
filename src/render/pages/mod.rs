//! MAP

mod draw_list;
mod projection;
mod visibility;

pub(crate) use draw_list::{Element, Listed, ListedPage, first_page, number_of_pages, room_for_pages, views_of};
pub(crate) use projection::{Count, PageProjection};
pub(crate) use visibility::{Open, PlacedCamera, Sight, VisiblePage};
